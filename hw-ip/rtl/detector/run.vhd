-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Runs of neighbouring hits.
--
-- Purpose     sums the hits of one laser that follow each other in a row; counts hits and rejected hits of the frame
-- Latency     a run is given when a hit that does not continue it, or the end of the frame, comes
-- Throughput  one hit per clock while runs are taken
-- Resources   about 200 LUT
-- Twin        karst_core: SpotDetector::row

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity run is
  generic (
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this
    G_LASER_BITS : positive range 1 to 10 := 4;   -- most lasers: 2 ** this
    G_FORMAL     : boolean := false               -- properties for the proof
  );
  port (
    clk           : in  std_ulogic;                                        -- rising edge
    rst           : in  std_ulogic;                                        -- synchronous, high: forgets what is under way
    in_valid      : in  std_ulogic;                                        -- hit is there; all as the outputs of sector
    in_ready      : out std_ulogic;                                        -- hit is taken if it is there
    in_end        : in  std_ulogic;
    in_accepted   : in  std_ulogic;
    in_joins      : in  std_ulogic;
    in_laser      : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    in_x          : in  std_ulogic_vector(G_X_BITS downto 0);
    in_y          : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_radius     : in  std_ulogic_vector(G_X_BITS + 4 downto 0);
    in_green      : in  std_ulogic;
    in_clipped    : in  std_ulogic;
    in_weight     : in  std_ulogic_vector(9 downto 0);
    in_weight_x   : in  std_ulogic_vector(G_X_BITS + 9 downto 0);
    out_valid     : out std_ulogic;                                        -- run or end is there, until it is taken
    out_ready     : in  std_ulogic;                                        -- it is taken if it is there
    out_end       : out std_ulogic;                                        -- end of a frame
    out_laser     : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);      -- the run's laser
    out_x_min     : out std_ulogic_vector(G_X_BITS - 1 downto 0);          -- leftmost column
    out_x_max     : out std_ulogic_vector(G_X_BITS - 1 downto 0);          -- rightmost column
    out_y         : out std_ulogic_vector(G_Y_BITS downto 0);              -- row; at the end: rows taken
    out_pixels    : out std_ulogic_vector(G_X_BITS downto 0);              -- hits; at the end: damaged rows
    out_green     : out std_ulogic_vector(G_X_BITS downto 0);              -- green ones
    out_saturated : out std_ulogic_vector(G_X_BITS downto 0);              -- clipped and core ones
    out_weight    : out std_ulogic_vector(G_X_BITS + 9 downto 0);          -- sum of weights
    out_weight_x  : out std_ulogic_vector(2 * G_X_BITS + 9 downto 0);      -- sum of weight times column
    out_r_max     : out std_ulogic_vector(G_X_BITS + 4 downto 0);          -- largest distance from the centre, 1/16 px
    hits          : out std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);   -- hits of the frame, valid at its end
    outside       : out std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0)    -- rejected ones among them
  );
end entity;

architecture rtl of run is

  subtype count_t is unsigned(G_X_BITS downto 0);
  subtype radius_t is unsigned(G_X_BITS + 4 downto 0);

  signal run_valid : std_ulogic;
  signal laser     : std_ulogic_vector(in_laser'range);
  signal x_min     : std_ulogic_vector(G_X_BITS - 1 downto 0);
  signal x_max     : std_ulogic_vector(G_X_BITS - 1 downto 0);
  signal y         : std_ulogic_vector(in_y'range);
  signal pixels    : count_t;
  signal green     : count_t;
  signal saturated : count_t;
  signal weight    : unsigned(out_weight'range);
  signal weight_x  : unsigned(out_weight_x'range);
  signal r_max     : radius_t;

  signal hit_count     : unsigned(hits'range);
  signal outside_count : unsigned(outside'range);

  signal starts : std_ulogic;  -- the hit starts a run
  signal take   : std_ulogic;

begin

  starts <= in_accepted and not in_joins;

  -- A run has to go before the next one starts or the frame ends
  out_valid <= in_valid and ((run_valid and starts) or in_end);
  out_end   <= not run_valid;
  in_ready  <= out_ready and not run_valid when in_end = '1' else out_ready or not (run_valid and starts);
  take      <= in_valid and in_ready;

  out_laser     <= laser;
  out_x_min     <= x_min;
  out_x_max     <= x_max;
  out_y         <= y when run_valid = '1' else in_y;
  out_pixels    <= std_ulogic_vector(pixels) when run_valid = '1' else in_x;
  out_green     <= std_ulogic_vector(green);
  out_saturated <= std_ulogic_vector(saturated);
  out_weight    <= std_ulogic_vector(weight);
  out_weight_x  <= std_ulogic_vector(weight_x);
  out_r_max     <= std_ulogic_vector(r_max);
  hits          <= std_ulogic_vector(hit_count);
  outside       <= std_ulogic_vector(outside_count);

  run_p : process (clk)
  begin
    if rising_edge(clk) then
      if out_valid = '1' and out_ready = '1' then
        run_valid <= '0';
      end if;
      if take = '1' and in_accepted = '1' then
        x_max <= in_x(x_max'range);
        if in_joins = '1' then
          pixels    <= pixels + 1;
          green     <= green + unsigned'("" & in_green);
          saturated <= saturated + unsigned'("" & in_clipped);
          weight    <= weight + unsigned(in_weight);
          weight_x  <= weight_x + unsigned(in_weight_x);
          if unsigned(in_radius) > r_max then
            r_max <= unsigned(in_radius);
          end if;
        else
          run_valid <= '1';
          laser     <= in_laser;
          x_min     <= in_x(x_min'range);
          y         <= in_y;
          pixels    <= to_unsigned(1, pixels'length);
          green     <= (0 => in_green, others => '0');
          saturated <= (0 => in_clipped, others => '0');
          weight    <= resize(unsigned(in_weight), weight'length);
          weight_x  <= resize(unsigned(in_weight_x), weight_x'length);
          r_max     <= unsigned(in_radius);
        end if;
      end if;
      if take = '1' then
        hit_count <= hit_count + 1;
        if in_accepted = '0' then
          outside_count <= outside_count + 1;
        end if;
        if in_end = '1' then
          hit_count     <= (others => '0');
          outside_count <= (others => '0');
        end if;
      end if;
      if rst = '1' then
        run_valid     <= '0';
        hit_count     <= (others => '0');
        outside_count <= (others => '0');
      end if;
    end if;
  end process;

  -- Every accepted hit and its weight is in one run, every end comes out once, and what is not taken stays
  formal_g : if G_FORMAL generate
    signal started     : std_ulogic := '0';
    signal was_held    : std_ulogic;  -- a hit had to wait: it stays, as AXI4-Stream has it
    signal was_hit     : std_ulogic_vector(in_laser'length + in_x'length + in_y'length + in_radius'length + in_weight'length
                                           + in_weight_x'length + 4 downto 0);
    signal hit         : std_ulogic_vector(was_hit'range);
    signal was_stalled : std_ulogic;
    signal was_end     : std_ulogic;
    signal was_pixels  : unsigned(out_pixels'range);
    signal hits_in     : unsigned(out_pixels'range);
    signal hits_out    : unsigned(out_pixels'range);
    signal weights_in  : unsigned(out_weight'range);
    signal weights_out : unsigned(out_weight'range);
    signal ends_in     : unsigned(1 downto 0);
    signal ends_out    : unsigned(1 downto 0);
    signal hits_held   : unsigned(out_pixels'range);
    signal weight_held : unsigned(out_weight'range);
  begin

    hit         <= in_end & in_accepted & in_joins & in_laser & in_x & in_y & in_radius & in_green & in_clipped & in_weight
                   & in_weight_x;
    hits_held   <= pixels when run_valid = '1' else (others => '0');
    weight_held <= weight when run_valid = '1' else (others => '0');

    score_p : process (clk)
    begin
      if rising_edge(clk) then
        started     <= '1';
        was_held    <= in_valid and not in_ready;
        was_hit     <= hit;
        was_stalled <= out_valid and not out_ready;
        was_end     <= out_end;
        was_pixels  <= unsigned(out_pixels);
        if take = '1' and in_accepted = '1' then
          hits_in    <= hits_in + 1;
          weights_in <= weights_in + unsigned(in_weight);
        end if;
        if take = '1' and in_end = '1' then
          ends_in <= ends_in + 1;
        end if;
        if out_valid = '1' and out_ready = '1' then
          if out_end = '1' then
            ends_out <= ends_out + 1;
          else
            hits_out    <= hits_out + unsigned(out_pixels);
            weights_out <= weights_out + unsigned(out_weight);
          end if;
        end if;
        if rst = '1' then
          was_held    <= '0';
          was_stalled <= '0';
          hits_in     <= (others => '0');
          hits_out    <= (others => '0');
          weights_in  <= (others => '0');
          weights_out <= (others => '0');
          ends_in     <= (others => '0');
          ends_out    <= (others => '0');
        end if;
      end if;
    end process;

    default clock is rising_edge(clk);
    begins_with_reset : assume always (started = '1' or rst = '1');
    hits_stay : assume always (was_held = '0' or (in_valid = '1' and hit = was_hit));
    ends_are_no_hits : assume always (in_end = '0' or in_accepted = '0');
    joins_a_run : assume always (in_joins = '0' or run_valid = '1');
    every_hit_in_one_run : assert always (started = '0' or hits_in - hits_out = hits_held);
    every_weight_in_one_run : assert always (started = '0' or weights_in - weights_out = weight_held);
    every_end_once : assert always (started = '0' or ends_in = ends_out);
    no_run_is_open_at_the_end : assert always (started = '0' or out_valid = '0' or out_end = '0' or run_valid = '0');
    kept_until_taken : assert always (started = '0' or was_stalled = '0' or (out_valid = '1' and out_end = was_end
      and unsigned(out_pixels) = was_pixels));

  end generate;

end architecture;
