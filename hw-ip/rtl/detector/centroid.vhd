-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Clusters in, spots out: sub-pixel position, variance, largest distance from the centre.
--
-- Purpose     divides the weighted sums by the weight, takes the root of the largest squared distance, estimates the variance,
--             formats the record
-- Method      one bit per clock: a non-restoring division and a root that share their quotient register, beside a
--             multiplication by shifts and additions
-- Latency     of a spot: four phases of 2 clocks and their steps: inverse of the mean weight, G_X_BITS + 25; root,
--             G_X_BITS + 6; column and square of the inverse, maximum(G_X_BITS + 15, 25); row and variance, 40; then 3.
--             127 with the default generics. Of a frame: 1
-- Throughput  one cluster per latency
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_core: SpotDetector::spot, SpotNoise::variance

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity centroid is
  generic (
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this, not above the widest
    G_LASER_BITS : positive range 1 to 10 := 4;   -- most lasers: 2 ** this
    G_SLOT_BITS  : positive range 1 to 3 := 2     -- candidates per laser: 2 ** this
  );
  port (
    clk             : in  std_ulogic;                                                -- rising edge
    rst             : in  std_ulogic;                                                -- synchronous, high: forgets what is
                                                                                     -- under way
    cfg_noise_floor : in  std_ulogic_vector(31 downto 0);                            -- SpotNoise::floor
    cfg_noise       : in  std_ulogic_vector(31 downto 0);                            -- SpotNoise::noise
    word_valid      : in  std_ulogic;                                                -- all as the outputs of cluster
    word_frame      : in  std_ulogic;
    word_last       : in  std_ulogic;
    word_index      : in  std_ulogic_vector(3 downto 0);
    word_data       : in  std_ulogic_vector(2 * G_X_BITS + G_Y_BITS + 9 downto 0);
    word_laser      : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    word_slot       : in  std_ulogic_vector(G_SLOT_BITS - 1 downto 0);
    ready           : out std_ulogic;                                                -- no spot is under way
    spot_valid      : out std_ulogic;                                                -- the spot's record is there, one clock
    frame_valid     : out std_ulogic;                                                -- the frame's record is there, one clock
    record_laser    : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);              -- the spot's laser
    record_slot     : out std_ulogic_vector(G_SLOT_BITS - 1 downto 0);               -- the spot's slot
    record_data     : out std_ulogic_vector(255 downto 0)                            -- the record, until the next words: see
                                                                                     -- detector
  );
end entity;

architecture rtl of centroid is

  constant COUNT_BITS : positive := G_X_BITS + G_Y_BITS + 1;
  constant WORD_BITS  : positive := 2 * G_X_BITS + G_Y_BITS + 10;
  constant ROOT_BITS  : positive := G_X_BITS + 6;  -- one below the point

  constant FRACTION         : positive := 14;  -- of a position
  constant INVERSE_FRACTION : positive := 24;  -- of the inverse of the mean weight, and of a variance
  constant NOISE_FRACTION   : positive := 16;  -- of cfg_noise

  -- A clock per bit of the result and of one below the point
  constant INVERSE_STEPS  : positive := G_X_BITS + INVERSE_FRACTION + 1;
  constant POSITION_STEPS : positive := G_X_BITS + FRACTION + 1;
  constant SQUARE_STEPS   : positive := INVERSE_FRACTION + 1;
  constant NOISE_STEPS    : positive := NOISE_FRACTION + INVERSE_FRACTION;

  constant QUOTIENT_BITS  : positive := 26;
  constant REMAINDER_BITS : positive := G_X_BITS + G_Y_BITS + 12;

  subtype word_t is std_ulogic_vector(WORD_BITS - 1 downto 0);

  -- Words of a cluster
  constant X_MIN          : natural := 0;
  constant X_MAX          : natural := 1;
  constant Y_MAX          : natural := 2;
  constant Y_MIN          : natural := 3;
  constant RADIUS_SQUARED : natural := 4;
  constant PIXELS         : natural := 5;
  constant SATURATED      : natural := 7;
  constant WEIGHT         : natural := 8;
  constant WEIGHT_X       : natural := 9;
  constant LASER          : natural := 10;
  constant WEIGHT_Y       : natural := 11;

  type words_t is array (0 to 15) of word_t;
  signal words : words_t;
  signal index : natural range 0 to 15;
  signal read_index : natural range 0 to 15;
  signal word  : word_t;

  type phase_t is (PH_IDLE, PH_INVERSE, PH_ROOT, PH_X, PH_Y, PH_DONE);
  signal phase    : phase_t;
  signal loads    : std_ulogic;             -- the clock after
  signal starts   : std_ulogic;             -- the phase takes its operand, and the result of the one before is there
  signal step     : unsigned(5 downto 0);   -- of the phase
  signal last_but_one : unsigned(5 downto 0);   -- its last step but one
  signal is_last  : std_ulogic;             -- this is its last step

  -- Division and root
  signal divides    : std_ulogic;
  signal roots      : std_ulogic;
  signal next_bits  : std_ulogic_vector(63 downto 0);  -- of the dividend: one per step
  signal divisor    : unsigned(G_X_BITS + G_Y_BITS + 9 downto 0);
  signal remainder  : unsigned(REMAINDER_BITS - 1 downto 0);
  signal next_bit   : std_ulogic;
  signal divide_b   : unsigned(REMAINDER_BITS - 1 downto 0);
  signal divide_sum : unsigned(REMAINDER_BITS downto 0);
  signal pairs      : std_ulogic_vector(31 downto 0);  -- of the radicand: one per step
  signal pair       : std_ulogic_vector(1 downto 0);
  signal root_remainder : unsigned(ROOT_BITS + 1 downto 0);
  signal root_b         : unsigned(ROOT_BITS - 1 downto 0);
  signal root_sum       : unsigned(ROOT_BITS downto 0);
  signal has_bit    : std_ulogic;                            -- a sign is one of the result
  signal quotient   : unsigned(QUOTIENT_BITS - 2 downto 0);  -- the bits of the quotient or root so far, but for the last one
  signal last_bit   : std_ulogic;                            -- which the sign of the remainder tells
  signal is_root    : std_ulogic;                            -- it is the root's
  signal result     : unsigned(QUOTIENT_BITS - 2 downto 0);  -- of the phase before, but for its last bit
  signal result_bit : std_ulogic;
  signal rounded    : unsigned(QUOTIENT_BITS - 2 downto 0);  -- when the next phase loads

  -- Multiplication
  signal multiplies    : std_ulogic;
  signal inverse       : std_ulogic_vector(24 downto 0);
  signal factor        : std_ulogic_vector(24 downto 0);  -- the inverse or its square, from the bit of this step on
  signal floor_bits    : std_ulogic_vector(63 downto 0);
  signal floor_bit     : std_ulogic;
  signal inverse_or_zero : unsigned(31 downto 0);  -- the factor that is added in this step
  signal noise_or_zero   : unsigned(31 downto 0);
  signal product       : unsigned(31 downto 0);  -- the part not yet shifted out
  signal product_sum   : unsigned(32 downto 0);
  signal product_low   : std_ulogic;             -- the bit that was shifted out last
  signal carry         : std_ulogic;
  signal too_large     : std_ulogic;
  signal variance_one  : std_ulogic;
  signal variance_low  : unsigned(INVERSE_FRACTION - 1 downto 0);

  -- The record
  signal is_frame  : std_ulogic;
  signal x         : std_ulogic_vector(24 downto 0);
  signal y         : std_ulogic_vector(24 downto 0);
  signal pixel_count     : std_ulogic_vector(COUNT_BITS - 1 downto 0);
  signal saturated_count : std_ulogic_vector(COUNT_BITS - 1 downto 0);
  signal x_low     : std_ulogic_vector(15 downto 0);
  signal x_high    : std_ulogic_vector(15 downto 0);
  signal y_low     : std_ulogic_vector(G_Y_BITS - 1 downto 0);
  signal y_high    : std_ulogic_vector(G_Y_BITS - 1 downto 0);
  signal radius    : std_ulogic_vector(15 downto 0);
  signal number    : std_ulogic_vector(15 downto 0);

  function padded(v : std_ulogic_vector; bits : positive) return std_ulogic_vector is
  begin
    return std_ulogic_vector(resize(unsigned(v), bits));
  end function;

  function reversed(v : std_ulogic_vector) return std_ulogic_vector is
    alias    source : std_ulogic_vector(0 to v'length - 1) is v;
    variable result : std_ulogic_vector(v'length - 1 downto 0);
  begin
    for i in result'range loop
      result(i) := source(i);
    end loop;
    return result;
  end function;

begin

  index <= to_integer(unsigned(word_index));

  read_index <= PIXELS when phase = PH_INVERSE else
                RADIUS_SQUARED when phase = PH_ROOT else
                WEIGHT_X when phase = PH_X else WEIGHT_Y;

  words_p : process (clk)
  begin
    if rising_edge(clk) then
      if word_valid = '1' then
        words(index) <= word_data;
      end if;
      word <= words(read_index);
    end if;
  end process;

  -- What the record takes as it is. Of the frame: hits, outside, overflow, rows, damaged rows
  record_p : process (clk)
  begin
    if rising_edge(clk) then
      if word_valid = '1' then
        is_frame <= word_frame;
        if index = X_MIN then
          x_low <= padded(word_data, 16);
        end if;
        if index = X_MAX then
          x_high <= padded(word_data, 16);
        end if;
        if index = Y_MIN then
          y_low <= word_data(y_low'range);
        end if;
        if index = Y_MAX then
          y_high <= word_data(y_high'range);
        end if;
        if index = PIXELS then
          pixel_count <= word_data(pixel_count'range);
        end if;
        if index = SATURATED then
          saturated_count <= word_data(saturated_count'range);
        end if;
        if index = WEIGHT then
          divisor <= unsigned(word_data(divisor'range));
        end if;
        if index = LASER then
          number       <= padded(word_data(maximum(G_X_BITS, G_LASER_BITS) downto 0), 16);
          record_laser <= word_laser;
          record_slot  <= word_slot;
        end if;
        if word_frame = '1' then
          y_low  <= (others => '0');
          y_high <= (others => '0');
        end if;
      end if;
      if loads = '1' and phase = PH_ROOT then
        inverse <= std_ulogic_vector(rounded);
      end if;
      if loads = '1' and phase = PH_X then
        radius <= padded(std_ulogic_vector(rounded(ROOT_BITS - 2 downto 0)), 16);
      elsif word_valid = '1' and index = RADIUS_SQUARED then
        -- The rows, if it is the frame's
        radius <= padded(word_data(G_Y_BITS downto 0), 16);
      end if;
      if loads = '1' and phase = PH_Y then
        x <= std_ulogic_vector(rounded);
      end if;
      if loads = '1' and phase = PH_DONE then
        y <= std_ulogic_vector(rounded);
      end if;
    end if;
  end process;

  with phase select last_but_one <=
    to_unsigned(INVERSE_STEPS - 1, 6) when PH_INVERSE,
    to_unsigned(ROOT_BITS - 1, 6) when PH_ROOT,
    to_unsigned(maximum(POSITION_STEPS, SQUARE_STEPS) - 1, 6) when PH_X,
    to_unsigned(NOISE_STEPS - 1, 6) when PH_Y,
    to_unsigned(0, 6) when PH_IDLE | PH_DONE;

  control_p : process (clk)
  begin
    if rising_edge(clk) then
      spot_valid  <= '0';
      frame_valid <= '0';
      starts      <= '0';
      loads       <= starts;
      step        <= step + 1;
      is_last     <= '1' when step = last_but_one else '0';
      if starts = '1' or phase = PH_IDLE then
        step <= (others => '0');
      end if;
      if starts = '1' then
        is_last <= '0';
      end if;
      case phase is
        when PH_IDLE =>
          is_last <= '0';
          if word_valid = '1' and word_last = '1' then
            frame_valid <= word_frame;
            if word_frame = '0' then
              phase  <= PH_INVERSE;
              starts <= '1';
            end if;
          end if;
        when PH_INVERSE =>
          if is_last = '1' then
            phase  <= PH_ROOT;
            starts <= '1';
          end if;
        when PH_ROOT =>
          if is_last = '1' then
            phase  <= PH_X;
            starts <= '1';
          end if;
        when PH_X =>
          if is_last = '1' then
            phase  <= PH_Y;
            starts <= '1';
          end if;
        when PH_Y =>
          if is_last = '1' then
            phase  <= PH_DONE;
            starts <= '1';
          end if;
        when PH_DONE =>
          if starts = '0' then
            spot_valid <= '1';
            phase      <= PH_IDLE;
          end if;
      end case;
      if rst = '1' then
        phase       <= PH_IDLE;
        spot_valid  <= '0';
        frame_valid <= '0';
      end if;
    end if;
  end process;

  ready <= '1' when phase = PH_IDLE and spot_valid = '0' else '0';

  -- The low bits of the dividend, then zeros
  next_bits(63 downto G_X_BITS)    <= (others => '0');
  next_bits(G_X_BITS - 1 downto 0) <= reversed(word(G_X_BITS - 1 downto 0));

  -- Always a subtraction: r + d = r - not d - 1. yosys then needs one LUT per bit
  divide_b   <= not resize(unsigned(word(WORD_BITS - 1 downto G_X_BITS)), REMAINDER_BITS) when loads = '1' else
                resize(divisor, REMAINDER_BITS) when remainder(REMAINDER_BITS - 1) = '0' else
                not resize(divisor, REMAINDER_BITS);
  divide_sum <= (remainder(REMAINDER_BITS - 2 downto 0) & next_bit & '0')
                - (divide_b & (loads or remainder(REMAINDER_BITS - 1)));

  pairs_g : for i in 0 to 15 generate
    in_g : if i < ROOT_BITS - 1 generate
      pairs(2 * i + 1 downto 2 * i) <= word(2 * (ROOT_BITS - 2 - i) + 1 downto 2 * (ROOT_BITS - 2 - i));
    end generate;
    below_g : if i >= ROOT_BITS - 1 generate
      pairs(2 * i + 1 downto 2 * i) <= "00";
    end generate;
  end generate;

  root_b   <= not quotient(ROOT_BITS - 2 downto 0) & has_bit when root_remainder(root_remainder'high) = '1' else
              quotient(ROOT_BITS - 2 downto 0) & has_bit;
  root_sum <= (root_remainder(ROOT_BITS - 1 downto 0) & '0') - (root_b & (pair(1) nor pair(0)));

  quotient_p : process (clk)
  begin
    if rising_edge(clk) then
      -- Of the next step
      next_bit <= next_bits(to_integer(step)) and not starts;
      pair     <= pairs(2 * to_integer(step(3 downto 0)) + 1) & pairs(2 * to_integer(step(3 downto 0)));
      if divides = '1' then
        remainder <= divide_sum(REMAINDER_BITS downto 1);
      end if;
      if roots = '1' then
        root_remainder <= root_sum(ROOT_BITS downto 1) & (pair(1) xnor pair(0)) & not pair(0);
      end if;
      if (divides = '1' or roots = '1') and has_bit = '1' then
        quotient <= quotient(QUOTIENT_BITS - 3 downto 0) & last_bit;
      end if;
      if loads = '0' and (divides = '1' or roots = '1') then
        has_bit <= '1';
      end if;
      if starts = '1' then
        remainder      <= (others => '0');
        root_remainder <= (others => '0');
        quotient       <= (others => '0');
        has_bit        <= '0';
        is_root        <= '0';
      end if;
      result     <= quotient;
      result_bit <= last_bit;
      -- In the next step
      if loads = '1' and phase = PH_ROOT then
        roots   <= '1';
        is_root <= '1';
      elsif phase /= PH_ROOT or is_last = '1' then
        roots <= '0';
      end if;
      if starts = '1' and (phase = PH_INVERSE or phase = PH_X or phase = PH_Y) then
        divides <= '1';
      elsif is_last = '1' or (phase /= PH_INVERSE and step = POSITION_STEPS) then
        divides <= '0';
      end if;
    end if;
  end process;

  last_bit <= not root_remainder(root_remainder'high) when is_root = '1' else not remainder(REMAINDER_BITS - 1);
  rounded  <= result + unsigned'("" & result_bit);

  -- The square of the inverse, then its product with the noise
  floor_bits <= padded(cfg_noise_floor(INVERSE_FRACTION - 1 downto 0), 64 - NOISE_FRACTION)
                & (NOISE_FRACTION - 1 downto 0 => '0');

  product_sum <= resize(product, 33) + (inverse_or_zero or noise_or_zero);

  product_p : process (clk)
    variable sum : unsigned(1 downto 0);
  begin
    if rising_edge(clk) then
      sum := unsigned'("0" & product_sum(0)) + unsigned'("0" & floor_bit) + unsigned'("0" & carry);
      factor <= '0' & factor(24 downto 1);
      if starts = '1' then
        factor <= inverse;
        if phase = PH_Y then
          factor <= std_ulogic_vector(product(23 downto 0)) & product_low;
        end if;
      end if;
      inverse_or_zero <= resize(unsigned(inverse), 32);
      if factor(0) = '0' or phase /= PH_X then
        inverse_or_zero <= (others => '0');
      end if;
      noise_or_zero <= unsigned(cfg_noise);
      if factor(0) = '0' or phase /= PH_Y then
        noise_or_zero <= (others => '0');
      end if;
      floor_bit <= floor_bits(to_integer(step));
      -- In the next step
      multiplies <= '0';
      if starts = '0' and (phase = PH_Y or step < SQUARE_STEPS) then
        multiplies <= '1';
      end if;
      if starts = '1' then
        product <= (others => '0');
        carry   <= '0';
      elsif multiplies = '1' then
        product      <= product_sum(32 downto 1);
        product_low  <= product_sum(0);
        carry        <= sum(1);
      end if;
      if multiplies = '1' and starts = '0' then
        variance_low <= sum(0) & variance_low(INVERSE_FRACTION - 1 downto 1);
      end if;
      -- What does not fit is 1 px^2
      too_large <= '0';
      if starts = '1' and phase = PH_DONE then
        too_large <= (or product) or carry or (or cfg_noise_floor(31 downto INVERSE_FRACTION));
      end if;
      variance_one <= too_large;
      if too_large = '1' then
        variance_low <= (others => '0');
      end if;
    end if;
  end process;

  record_data <= number & radius & padded(y_high, 16) & padded(y_low, 16) & x_high & x_low
                 & padded(saturated_count, 32) & padded(pixel_count, 32)
                 & padded(variance_one & std_ulogic_vector(variance_low), 32) & padded(y, 32) & padded(x, 32);

end architecture;
