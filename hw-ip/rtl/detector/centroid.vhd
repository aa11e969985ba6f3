-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Clusters in, spots out: sub-pixel position and variance.
--
-- Purpose     divides the weighted sums by the weight, estimates the variance, formats the result stream
-- Latency     41 from in_valid to m_axis_tvalid: operands 1, three divisions 29 + 2, variance 6, buffer 2 and 1
-- Throughput  one cluster per 4 clocks
-- Resources   one divide, about 300 LUT, 8 DSP
-- Twin        karst_core: SpotDetector::spot, SpotNoise::variance

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity centroid is
  generic (
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this, not above the widest
    G_LASER_BITS : positive range 1 to 10 := 4    -- most lasers: 2 ** this
  );
  port (
    clk             : in  std_ulogic;                                                -- rising edge
    rst             : in  std_ulogic;                                                -- synchronous, high: forgets what is
                                                                                     -- under way
    cfg_noise_floor : in  std_ulogic_vector(31 downto 0);                            -- SpotNoise::floor
    cfg_noise       : in  std_ulogic_vector(31 downto 0);                            -- SpotNoise::noise
    in_valid        : in  std_ulogic;                                                -- all as the outputs of cluster
    in_ready        : out std_ulogic;
    in_end          : in  std_ulogic;
    in_laser        : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    in_pixels       : in  std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
    in_saturated    : in  std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
    in_weight       : in  std_ulogic_vector(G_X_BITS + G_Y_BITS + 9 downto 0);
    in_weight_x     : in  std_ulogic_vector(2 * G_X_BITS + G_Y_BITS + 9 downto 0);
    in_weight_y     : in  std_ulogic_vector(G_X_BITS + 2 * G_Y_BITS + 9 downto 0);
    in_x_min        : in  std_ulogic_vector(G_X_BITS - 1 downto 0);
    in_x_max        : in  std_ulogic_vector(G_X_BITS - 1 downto 0);
    in_y_min        : in  std_ulogic_vector(G_Y_BITS - 1 downto 0);
    in_y_max        : in  std_ulogic_vector(G_Y_BITS - 1 downto 0);
    in_r_max        : in  std_ulogic_vector(G_X_BITS + 4 downto 0);
    in_rows         : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_damaged      : in  std_ulogic_vector(G_X_BITS downto 0);
    in_overflow     : in  std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
    m_axis_tvalid   : out std_ulogic;                                                -- record is there, until it is taken
    m_axis_tready   : in  std_ulogic;                                                -- record is taken if it is there
    m_axis_tdata    : out std_ulogic_vector(255 downto 0);                           -- the record: see detector
    m_axis_tlast    : out std_ulogic                                                 -- the frame's record
  );
end entity;

architecture rtl of centroid is

  constant FRACTION         : positive := 14;  -- of a position
  constant INVERSE_FRACTION : positive := 24;  -- of the inverse of the mean weight, and of a variance

  -- A position has 11 + 14 bits, the inverse of a mean weight 1 + 24, and the divider takes a sign
  constant QUOTIENT_WIDTH    : positive := 26;
  constant NUMERATOR_WIDTH   : positive := 2 * G_X_BITS + G_Y_BITS + 10 + FRACTION + 1;
  constant DENOMINATOR_WIDTH : positive := G_X_BITS + G_Y_BITS + 10 + 1;

  subtype quotient_t is std_ulogic_vector(QUOTIENT_WIDTH - 1 downto 0);
  subtype result_t is std_ulogic_vector(24 downto 0);
  type result_array_t is array (natural range <>) of result_t;

  -- Operands: x, y, inverse of the mean weight, in this order
  signal to_divide : natural range 0 to 3;  -- divisions of the cluster still to be started
  signal weight    : std_ulogic_vector(in_weight'range);
  signal weight_x  : std_ulogic_vector(in_weight_x'range);
  signal weight_y  : std_ulogic_vector(in_weight_y'range);
  signal pixels    : std_ulogic_vector(in_pixels'range);
  signal numerator   : std_ulogic_vector(NUMERATOR_WIDTH - 1 downto 0);
  signal denominator : std_ulogic_vector(DENOMINATOR_WIDTH - 1 downto 0);
  signal divide_start : std_ulogic;
  signal divide_done  : std_ulogic;
  signal quotient     : quotient_t;

  -- Results
  signal divided : natural range 0 to 2;  -- quotients of a cluster that have come
  signal x       : result_t;
  signal y       : result_t;
  constant VARIANCE_STAGES : positive := 6;
  signal valid_at : std_ulogic_vector(1 to VARIANCE_STAGES);
  signal x_at     : result_array_t(1 to VARIANCE_STAGES);
  signal y_at     : result_array_t(1 to VARIANCE_STAGES);
  signal inverse       : unsigned(24 downto 0);
  signal square        : unsigned(49 downto 0);
  signal noise         : unsigned(56 downto 0);
  signal noise_held    : unsigned(56 downto 0);
  signal sum           : unsigned(41 downto 0);
  signal variance      : unsigned(24 downto 0);

  -- What waits beside the division
  constant RECORD_BITS : positive := 256 - 3 * 32 + 1;
  subtype record_t is std_ulogic_vector(RECORD_BITS - 1 downto 0);
  signal spot_record  : record_t;
  signal frame_record : record_t;
  signal side_in      : record_t;
  signal side_out     : record_t;
  signal side_ready   : std_ulogic;
  signal side_valid   : std_ulogic;
  signal result_valid : std_ulogic;
  signal result_in    : std_ulogic_vector(74 downto 0);
  signal result_out   : std_ulogic_vector(74 downto 0);
  signal take         : std_ulogic;
  signal give         : std_ulogic;

  function padded(v : std_ulogic_vector; bits : positive) return std_ulogic_vector is
  begin
    return std_ulogic_vector(resize(unsigned(v), bits));
  end function;

begin

  in_ready <= side_ready when to_divide = 0 else '0';
  take     <= in_valid and in_ready;

  operands_p : process (clk)
  begin
    if rising_edge(clk) then
      if take = '1' then
        to_divide <= 3;
        weight    <= in_weight;
        weight_x  <= in_weight_x;
        weight_y  <= in_weight_y;
        pixels    <= in_pixels;
      elsif to_divide > 0 then
        to_divide <= to_divide - 1;
      end if;
      if rst = '1' then
        to_divide <= 0;
      end if;
    end if;
  end process;

  divide_start <= '0' when to_divide = 0 else '1';
  denominator  <= '0' & weight;

  numerator <=
    std_ulogic_vector(shift_left(resize(unsigned(weight_x), NUMERATOR_WIDTH), FRACTION)) when to_divide = 3 else
    std_ulogic_vector(shift_left(resize(unsigned(weight_y), NUMERATOR_WIDTH), FRACTION)) when to_divide = 2 else
    std_ulogic_vector(shift_left(resize(unsigned(pixels), NUMERATOR_WIDTH), INVERSE_FRACTION));

  divide_i : entity work.divide
    generic map (
      G_NUMERATOR_WIDTH   => NUMERATOR_WIDTH,
      G_DENOMINATOR_WIDTH => DENOMINATOR_WIDTH,
      G_QUOTIENT_WIDTH    => QUOTIENT_WIDTH
    )
    port map (
      clk         => clk,
      rst         => rst,
      in_valid    => divide_start,
      numerator   => numerator,
      denominator => denominator,
      out_valid   => divide_done,
      quotient    => quotient
    );

  results_p : process (clk)
    constant LARGEST : natural := 2 ** INVERSE_FRACTION;
  begin
    if rising_edge(clk) then
      valid_at <= '0' & valid_at(1 to VARIANCE_STAGES - 1);
      x_at     <= x & x_at(1 to VARIANCE_STAGES - 1);
      y_at     <= y & y_at(1 to VARIANCE_STAGES - 1);
      if divide_done = '1' then
        if divided = 0 then
          x       <= quotient(result_t'range);
          divided <= 1;
        elsif divided = 1 then
          y       <= quotient(result_t'range);
          divided <= 2;
        else
          valid_at(1) <= '1';
          divided     <= 0;
        end if;
      end if;
      inverse    <= unsigned(quotient(24 downto 0));
      square     <= inverse * inverse;
      noise      <= square(48 downto 24) * unsigned(cfg_noise);
      noise_held <= noise;
      sum        <= resize(noise_held(56 downto 16), 42) + unsigned(cfg_noise_floor);
      if sum > LARGEST then
        variance <= to_unsigned(LARGEST, 25);
      else
        variance <= sum(24 downto 0);
      end if;
      if rst = '1' then
        valid_at <= (others => '0');
        divided  <= 0;
      end if;
    end if;
  end process;

  result_in <= x_at(VARIANCE_STAGES) & y_at(VARIANCE_STAGES) & std_ulogic_vector(variance);

  -- As many results as there are records at the side, so that this one can not overflow
  results_i : entity work.fifo
    generic map (G_WIDTH => 75, G_LOG2_DEPTH => 5)
    port map (
      clk       => clk,
      rst       => rst,
      in_valid  => valid_at(VARIANCE_STAGES),
      in_ready  => open,
      in_data   => result_in,
      room      => open,
      out_valid => result_valid,
      out_ready => give,
      out_data  => result_out
    );

  spot_record  <= '0' & padded(in_laser, 16) & padded(in_r_max, 16) & padded(in_y_max, 16) & padded(in_y_min, 16)
                  & padded(in_x_max, 16) & padded(in_x_min, 16) & padded(in_saturated, 32) & padded(in_pixels, 32);
  frame_record <= '1' & padded(in_damaged, 16) & padded(in_rows, 16) & padded("0", 32) & padded(in_overflow, 32)
                  & padded(in_saturated, 32) & padded(in_pixels, 32);
  side_in      <= frame_record when in_end = '1' else spot_record;

  side_i : entity work.fifo
    generic map (G_WIDTH => RECORD_BITS, G_LOG2_DEPTH => 4)
    port map (
      clk       => clk,
      rst       => rst,
      in_valid  => take,
      in_ready  => side_ready,
      in_data   => side_in,
      room      => open,
      out_valid => side_valid,
      out_ready => give,
      out_data  => side_out
    );

  give          <= m_axis_tready and result_valid and side_valid;
  m_axis_tvalid <= result_valid and side_valid;
  m_axis_tlast  <= side_out(RECORD_BITS - 1);
  m_axis_tdata  <= side_out(RECORD_BITS - 2 downto 0) & padded(result_out(24 downto 0), 32)
                   & padded(result_out(49 downto 25), 32) & padded(result_out(74 downto 50), 32);

end architecture;
