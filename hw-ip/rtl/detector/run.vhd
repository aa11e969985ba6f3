-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Runs of neighbouring hits.
--
-- Purpose     sums the hits of one laser that follow each other in a row; counts hits and rejected hits of the frame
-- Latency     a run is complete when something that does not continue it comes: a hit, the news that its row is over, or
--             the end of the frame. 3 from there to out_valid
-- Throughput  one hit per clock; while a complete run waits for the output the next one is summed, and two hits wait at the
--             input, so that in_ready is a register
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_core: SpotDetector::row

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity run is
  generic (
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this
    G_LASER_BITS : positive range 1 to 10 := 4    -- most lasers: 2 ** this
  );
  port (
    clk                : in  std_ulogic;                                        -- rising edge
    rst                : in  std_ulogic;                                        -- synchronous, high: forgets what is under way
    in_valid           : in  std_ulogic;                                        -- hit is there; all as the outputs of sector
    in_ready           : out std_ulogic;                                        -- hit is taken if it is there
    in_end             : in  std_ulogic;
    in_accepted        : in  std_ulogic;
    in_joins           : in  std_ulogic;
    in_laser           : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    in_x               : in  std_ulogic_vector(G_X_BITS downto 0);
    in_y               : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_radius_squared  : in  std_ulogic_vector(2 * G_X_BITS + 9 downto 0);
    in_green           : in  std_ulogic;
    in_clipped         : in  std_ulogic;
    in_weight          : in  std_ulogic_vector(9 downto 0);
    in_weight_x        : in  std_ulogic_vector(G_X_BITS + 9 downto 0);
    row_valid          : in  std_ulogic;                                        -- news: no more hits above a row, until taken
    row_ready          : out std_ulogic;                                        -- they are taken if they are there
    row                : in  std_ulogic_vector(G_Y_BITS downto 0);              -- that row
    out_valid          : out std_ulogic;                                        -- run or end is there, until it is taken
    out_ready          : in  std_ulogic;                                        -- it is taken if it is there
    out_end            : out std_ulogic;                                        -- end of a frame
    out_laser          : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);      -- the run's laser
    out_x_min          : out std_ulogic_vector(G_X_BITS downto 0);              -- leftmost column; at the end: damaged rows
    out_x_max          : out std_ulogic_vector(G_X_BITS - 1 downto 0);          -- rightmost column
    out_y              : out std_ulogic_vector(G_Y_BITS downto 0);              -- row; at the end: rows taken; without a run:
                                                                                -- no later run is above this row
    out_pixels         : out std_ulogic_vector(G_X_BITS downto 0);              -- hits
    out_green          : out std_ulogic_vector(G_X_BITS downto 0);              -- green ones
    out_saturated      : out std_ulogic_vector(G_X_BITS downto 0);              -- clipped and core ones
    out_weight         : out std_ulogic_vector(G_X_BITS + 9 downto 0);          -- sum of weights
    out_weight_x       : out std_ulogic_vector(2 * G_X_BITS + 9 downto 0);      -- sum of weight times column
    out_radius_squared : out std_ulogic_vector(2 * G_X_BITS + 9 downto 0);      -- largest square of the distance from the
                                                                                -- centre, (1/16 px)^2
    hits               : out std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);   -- hits of the frame, valid at its end
    outside            : out std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0)    -- rejected ones among them
  );
end entity;

architecture rtl of run is

  subtype count_t is unsigned(G_X_BITS downto 0);
  subtype radius_squared_t is unsigned(2 * G_X_BITS + 9 downto 0);

  -- The sum so far, or nothing for the first hit. As the second operand of an addition the choice takes no LUT
  function if_joins(value : unsigned; joins : std_ulogic) return unsigned is
    variable result : unsigned(value'length - 1 downto 0) := (others => '0');
  begin
    if joins = '1' then
      result := value;
    end if;
    return result;
  end function;

  type hit_t is record
    is_end         : std_ulogic;
    accepted       : std_ulogic;
    joins          : std_ulogic;
    laser          : std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    x              : std_ulogic_vector(G_X_BITS downto 0);
    y              : std_ulogic_vector(G_Y_BITS downto 0);
    radius_squared : radius_squared_t;
    green          : std_ulogic;
    clipped        : std_ulogic;
    weight         : unsigned(9 downto 0);
    weight_x       : unsigned(G_X_BITS + 9 downto 0);
  end record;

  -- The hit at the input, and those that have been taken: the next one, and one behind it if that has to wait
  signal in_hit      : hit_t;
  signal hit         : hit_t;
  signal hit_valid   : std_ulogic;
  signal spare       : hit_t;
  signal spare_valid : std_ulogic;

  -- The run that is summed, or the end
  signal open_run      : std_ulogic;
  signal is_end        : std_ulogic;
  signal laser         : std_ulogic_vector(in_laser'range);
  signal x_min         : std_ulogic_vector(in_x'range);
  signal x_max         : std_ulogic_vector(G_X_BITS - 1 downto 0);
  signal y             : std_ulogic_vector(in_y'range);  -- of the last hit or news: no later hit is above it
  signal pixels        : count_t;
  signal green         : count_t;
  signal saturated     : count_t;
  signal weight        : unsigned(out_weight'range);
  signal weight_x      : unsigned(out_weight_x'range);
  signal first_squared : radius_squared_t;  -- of the first hit's radius
  signal last_squared  : radius_squared_t;  -- of the last one's

  -- The same at the output
  signal out_first_squared : radius_squared_t;
  signal out_last_squared  : radius_squared_t;
  signal last_is_larger    : std_ulogic;

  signal took_hit      : std_ulogic;
  signal took_outside  : std_ulogic;  -- of these: a rejected one
  signal hit_count     : unsigned(hits'range);
  signal outside_count : unsigned(outside'range);

  signal row_differs : std_ulogic;
  signal give        : std_ulogic;  -- the run goes to the output
  signal take        : std_ulogic;  -- the hit enters a run
  signal moves       : std_ulogic;  -- another one can follow it
  signal vacant      : std_ulogic;  -- nothing is at the output
  signal ending      : std_ulogic;  -- the end of the frame is on its way: the counters stay

begin

  row_differs <= '1' when row /= y else '0';

  -- A run has to go before the next one starts, its row is over, or the frame ends
  give <= open_run and vacant and (is_end or (row_valid and row_differs)
                                   or (not row_valid and hit_valid and not hit.joins));
  take <= hit_valid and not row_valid and not ending and (hit.joins or not open_run or vacant);

  moves     <= take or not hit_valid;
  in_ready  <= not spare_valid;
  row_ready <= not ending and (not open_run or not row_differs or vacant);

  in_hit <= (
    is_end         => in_end,
    accepted       => in_accepted,
    joins          => in_joins,
    laser          => in_laser,
    x              => in_x,
    y              => in_y,
    radius_squared => unsigned(in_radius_squared),
    green          => in_green,
    clipped        => in_clipped,
    weight         => unsigned(in_weight),
    weight_x       => unsigned(in_weight_x)
  );

  input_p : process (clk)
  begin
    if rising_edge(clk) then
      if spare_valid = '0' then
        spare       <= in_hit;
        spare_valid <= in_valid and not moves;
      elsif moves = '1' then
        spare_valid <= '0';
      end if;
      if moves = '1' then
        hit       <= in_hit;
        hit_valid <= in_valid;
        if spare_valid = '1' then
          hit       <= spare;
          hit_valid <= '1';
        end if;
      end if;
      if rst = '1' then
        hit_valid   <= '0';
        spare_valid <= '0';
      end if;
    end if;
  end process;

  run_p : process (clk)
  begin
    if rising_edge(clk) then
      if give = '1' then
        open_run <= '0';
        is_end   <= '0';
      end if;
      if row_valid = '1' and row_ready = '1' then
        y <= row;
      end if;
      if take = '1' then
        y <= hit.y;
        if hit.is_end = '1' then
          ending <= '1';
        end if;
        if hit.is_end = '1' or hit.accepted = '1' then
          open_run  <= '1';
          is_end    <= hit.is_end;
          x_max     <= hit.x(x_max'range);
          pixels    <= to_unsigned(1, pixels'length) + if_joins(pixels, hit.joins);
          green     <= unsigned'("" & hit.green) + if_joins(green, hit.joins);
          saturated <= unsigned'("" & hit.clipped) + if_joins(saturated, hit.joins);
          weight    <= resize(hit.weight, weight'length) + if_joins(weight, hit.joins);
          weight_x  <= resize(hit.weight_x, weight_x'length) + if_joins(weight_x, hit.joins);
          last_squared <= hit.radius_squared;
          if hit.joins = '0' then
            laser         <= hit.laser;
            x_min         <= hit.x;
            first_squared <= hit.radius_squared;
          end if;
        end if;
      end if;
      -- A clock later: the end does not overtake its hits
      took_hit     <= take and not hit.is_end;
      took_outside <= take and not hit.is_end and not hit.accepted;
      if took_hit = '1' then
        hit_count <= hit_count + 1;
      end if;
      if took_outside = '1' then
        outside_count <= outside_count + 1;
      end if;
      if out_valid = '1' and out_ready = '1' and out_end = '1' then
        ending        <= '0';
        hit_count     <= (others => '0');
        outside_count <= (others => '0');
      end if;
      if rst = '1' then
        open_run      <= '0';
        is_end        <= '0';
        ending        <= '0';
        took_hit      <= '0';
        took_outside  <= '0';
        hit_count     <= (others => '0');
        outside_count <= (others => '0');
      end if;
    end if;
  end process;

  output_p : process (clk)
  begin
    if rising_edge(clk) then
      if vacant = '1' then
        vacant            <= not give;
        out_end           <= is_end;
        out_laser         <= laser;
        out_x_min         <= x_min;
        out_x_max         <= x_max;
        out_y             <= y;
        out_pixels        <= std_ulogic_vector(pixels);
        out_green         <= std_ulogic_vector(green);
        out_saturated     <= std_ulogic_vector(saturated);
        out_weight        <= std_ulogic_vector(weight);
        out_weight_x      <= std_ulogic_vector(weight_x);
        out_first_squared <= first_squared;
        out_last_squared  <= last_squared;
        last_is_larger    <= '1' when last_squared > first_squared else '0';
      elsif out_ready = '1' then
        vacant <= '1';
      end if;
      if rst = '1' then
        vacant <= '1';
      end if;
    end if;
  end process;

  out_valid <= not vacant;

  -- Along a row the square of the radius is convex: the first hit of a run or the last one has the largest
  out_radius_squared <= std_ulogic_vector(out_last_squared) when last_is_larger = '1' else std_ulogic_vector(out_first_squared);

  hits    <= std_ulogic_vector(hit_count);
  outside <= std_ulogic_vector(outside_count);

end architecture;
