-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The candidate spots of every laser.
--
-- Purpose     joins runs to clusters whose boxes are within the gap, up to 2 ** G_SLOT_BITS per laser; with all slots taken
--             the cluster of the fewest pixels makes room. At the end of the frame gives the clusters of every laser, then
--             the frame's counters
-- Latency     a run takes 3 clocks if its laser has no cluster yet, else 5 and 1 per cluster it has. The end of a frame
--             takes 2 clocks per laser, 4 per cluster and 1
-- Throughput  one run per latency
-- Resources   about 900 LUT, one memory of 2 ** (G_LASER_BITS + G_SLOT_BITS) clusters
-- Twin        karst_core: Candidates::add, Cluster::merge, SpotDetector::spots

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity cluster is
  generic (
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this
    G_LASER_BITS : positive range 1 to 10 := 4;   -- most lasers: 2 ** this
    G_SLOT_BITS  : positive range 1 to 3 := 2     -- candidates per laser: 2 ** this
  );
  port (
    clk             : in  std_ulogic;                                        -- rising edge
    rst             : in  std_ulogic;                                        -- synchronous, high: forgets all clusters, which
                                                                             -- takes one clock per laser
    cfg_lasers      : in  std_ulogic_vector(G_LASER_BITS downto 0);          -- how many there are
    cfg_cluster_gap : in  std_ulogic_vector(10 downto 0);                    -- DetectorConfig::cluster_gap; more than 2047 is
                                                                             -- the same as 2047
    cfg_min_pixels  : in  std_ulogic_vector(15 downto 0);                    -- DetectorConfig::min_pixels
    in_valid        : in  std_ulogic;                                        -- run is there; all as the outputs of run
    in_ready        : out std_ulogic;                                        -- run is taken if it is there
    in_end          : in  std_ulogic;
    in_laser        : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    in_x_min        : in  std_ulogic_vector(G_X_BITS - 1 downto 0);
    in_x_max        : in  std_ulogic_vector(G_X_BITS - 1 downto 0);
    in_y            : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_pixels       : in  std_ulogic_vector(G_X_BITS downto 0);
    in_green        : in  std_ulogic_vector(G_X_BITS downto 0);
    in_saturated    : in  std_ulogic_vector(G_X_BITS downto 0);
    in_weight       : in  std_ulogic_vector(G_X_BITS + 9 downto 0);
    in_weight_x     : in  std_ulogic_vector(2 * G_X_BITS + 9 downto 0);
    in_r_max        : in  std_ulogic_vector(G_X_BITS + 4 downto 0);
    in_hits         : in  std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
    in_outside      : in  std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
    out_valid       : out std_ulogic;                                                -- cluster or end is there, until taken
    out_ready       : in  std_ulogic;                                                -- it is taken if it is there
    out_end         : out std_ulogic;                                                -- end of a frame
    out_laser       : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);              -- the cluster's laser
    out_pixels      : out std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);           -- Cluster::pixels; at the end: hits
    out_saturated   : out std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);           -- Cluster::saturated; at the end: outside
    out_weight      : out std_ulogic_vector(G_X_BITS + G_Y_BITS + 9 downto 0);       -- Cluster::weight
    out_weight_x    : out std_ulogic_vector(2 * G_X_BITS + G_Y_BITS + 9 downto 0);   -- Cluster::weight_x
    out_weight_y    : out std_ulogic_vector(G_X_BITS + 2 * G_Y_BITS + 9 downto 0);   -- Cluster::weight_y
    out_x_min       : out std_ulogic_vector(G_X_BITS - 1 downto 0);                  -- Bounds::x_min
    out_x_max       : out std_ulogic_vector(G_X_BITS - 1 downto 0);                  -- Bounds::x_max
    out_y_min       : out std_ulogic_vector(G_Y_BITS - 1 downto 0);                  -- Bounds::y_min
    out_y_max       : out std_ulogic_vector(G_Y_BITS - 1 downto 0);                  -- Bounds::y_max
    out_r_max       : out std_ulogic_vector(G_X_BITS + 4 downto 0);                  -- Cluster::r_max
    out_rows        : out std_ulogic_vector(G_Y_BITS downto 0);                      -- at the end: rows taken
    out_damaged     : out std_ulogic_vector(G_X_BITS downto 0);                      -- at the end: damaged rows
    out_overflow    : out std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0)            -- at the end: hits lost for want of slots
  );
end entity;

architecture rtl of cluster is

  constant SLOTS : positive := 2 ** G_SLOT_BITS;

  subtype count_t is unsigned(G_X_BITS + G_Y_BITS downto 0);
  subtype weight_t is unsigned(G_X_BITS + G_Y_BITS + 9 downto 0);
  subtype weight_x_t is unsigned(2 * G_X_BITS + G_Y_BITS + 9 downto 0);
  subtype weight_y_t is unsigned(G_X_BITS + 2 * G_Y_BITS + 9 downto 0);
  subtype x_t is unsigned(G_X_BITS - 1 downto 0);
  subtype y_t is unsigned(G_Y_BITS - 1 downto 0);
  subtype radius_t is unsigned(G_X_BITS + 4 downto 0);
  subtype laser_t is unsigned(G_LASER_BITS - 1 downto 0);
  subtype slot_t is unsigned(G_SLOT_BITS - 1 downto 0);
  subtype mask_t is std_ulogic_vector(SLOTS - 1 downto 0);

  type cluster_t is record
    pixels    : count_t;
    green     : count_t;
    saturated : count_t;
    weight    : weight_t;
    weight_x  : weight_x_t;
    weight_y  : weight_y_t;
    x_min     : x_t;
    x_max     : x_t;
    y_min     : y_t;
    y_max     : y_t;
    r_max     : radius_t;
  end record;

  constant COUNT_BITS   : positive := count_t'length;
  constant CLUSTER_BITS : positive := 3 * COUNT_BITS + weight_t'length + weight_x_t'length + weight_y_t'length
                                      + 2 * G_X_BITS + 2 * G_Y_BITS + radius_t'length;
  subtype cluster_vector_t is unsigned(CLUSTER_BITS - 1 downto 0);

  function to_vector(c : cluster_t) return cluster_vector_t is
  begin
    return c.pixels & c.green & c.saturated & c.weight & c.weight_x & c.weight_y
      & c.x_min & c.x_max & c.y_min & c.y_max & c.r_max;
  end function;

  function to_cluster(v : cluster_vector_t) return cluster_t is
    variable rest : cluster_vector_t := v;
    variable c    : cluster_t;
  begin
    c.r_max := rest(radius_t'range);
    rest := shift_right(rest, radius_t'length);
    c.y_max := rest(y_t'range);
    rest := shift_right(rest, G_Y_BITS);
    c.y_min := rest(y_t'range);
    rest := shift_right(rest, G_Y_BITS);
    c.x_max := rest(x_t'range);
    rest := shift_right(rest, G_X_BITS);
    c.x_min := rest(x_t'range);
    rest := shift_right(rest, G_X_BITS);
    c.weight_y := rest(weight_y_t'range);
    rest := shift_right(rest, weight_y_t'length);
    c.weight_x := rest(weight_x_t'range);
    rest := shift_right(rest, weight_x_t'length);
    c.weight := rest(weight_t'range);
    rest := shift_right(rest, weight_t'length);
    c.saturated := rest(count_t'range);
    rest := shift_right(rest, COUNT_BITS);
    c.green := rest(count_t'range);
    rest := shift_right(rest, COUNT_BITS);
    c.pixels := rest(count_t'range);
    return c;
  end function;

  -- The lowest bit of a mask that is set
  function lowest(mask : mask_t) return slot_t is
    variable slot : slot_t := (others => '0');
  begin
    for i in SLOTS - 1 downto 0 loop
      if mask(i) = '1' then
        slot := to_unsigned(i, G_SLOT_BITS);
      end if;
    end loop;
    return slot;
  end function;

  function one_hot(slot : slot_t) return mask_t is
    variable mask : mask_t := (others => '0');
  begin
    mask(to_integer(slot)) := '1';
    return mask;
  end function;

  type state_t is (S_CLEAR, S_IDLE, S_PREPARE, S_SCAN, S_READ, S_GIVE, S_END);
  signal state : state_t;

  type memory_t is array (0 to 2 ** (G_LASER_BITS + G_SLOT_BITS) - 1) of cluster_vector_t;
  signal memory      : memory_t;
  signal memory_read : cluster_vector_t;

  -- Which slots of a laser hold a cluster
  type used_memory_t is array (0 to 2 ** G_LASER_BITS - 1) of mask_t;
  signal used_memory : used_memory_t;
  signal used        : mask_t;
  signal used_write  : std_ulogic;
  signal used_data   : mask_t;

  signal laser  : laser_t;
  signal merged : cluster_t;  -- the run and the clusters it has joined so far

  -- The run's box, widened by the gap; y_max needs no test: rows come in order
  signal x_low  : unsigned(11 downto 0);
  signal x_high : unsigned(11 downto 0);
  signal y_low  : unsigned(11 downto 0);

  -- Slots on their way out of the memory
  signal asked    : mask_t;  -- these have been addressed
  signal waiting  : mask_t;  -- these not yet
  signal ask      : std_ulogic;
  signal ask_slot : slot_t;
  signal read_valid : std_ulogic;  -- beside memory_read
  signal read_slot  : slot_t;
  signal slot_valid : std_ulogic;  -- beside slot_cluster
  signal slot       : slot_t;
  signal slot_cluster : cluster_t;
  signal slot_near    : std_ulogic;
  signal slot_enough  : std_ulogic;

  signal freed         : mask_t;  -- these have joined the run
  signal free          : mask_t;
  signal fewest        : count_t;
  signal fewest_slot   : slot_t;
  signal target        : slot_t;
  signal scanned       : std_ulogic;

  signal overflow : count_t;
  signal rows     : std_ulogic_vector(in_y'range);
  signal damaged  : std_ulogic_vector(in_pixels'range);
  signal hits     : std_ulogic_vector(in_hits'range);
  signal outside  : std_ulogic_vector(in_outside'range);

  signal give : std_ulogic;  -- slot_cluster is at the output
  signal last_laser : std_ulogic;

begin

  in_ready <= '1' when state = S_IDLE else '0';

  waiting  <= used and not asked;
  -- While clusters are given away, one at a time
  ask      <= '1' when waiting /= (waiting'range => '0')
                       and (state = S_SCAN or (state = S_GIVE and read_valid = '0' and slot_valid = '0' and give = '0'))
                  else '0';
  ask_slot <= lowest(waiting);
  free     <= freed or not used;
  target   <= lowest(free) when free /= (free'range => '0') else fewest_slot;
  scanned  <= '1' when ask = '0' and read_valid = '0' and slot_valid = '0' and give = '0' else '0';

  last_laser <= '1' when laser + 1 = unsigned(cfg_lasers(G_LASER_BITS - 1 downto 0)) else '0';

  used_write <= '1' when state = S_CLEAR or ((state = S_SCAN or state = S_GIVE) and scanned = '1') else '0';
  used_data  <= (used and not freed) or one_hot(target) when state = S_SCAN else (others => '0');

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      memory_read <= memory(to_integer(laser & ask_slot));
      if state = S_SCAN and scanned = '1' then
        memory(to_integer(laser & target)) <= to_vector(merged);
      end if;
    end if;
  end process;

  used_p : process (clk)
  begin
    if rising_edge(clk) then
      if state = S_PREPARE or state = S_READ then
        used <= used_memory(to_integer(laser));
      end if;
      if used_write = '1' then
        used_memory(to_integer(laser)) <= used_data;
      end if;
    end if;
  end process;

  slots_p : process (clk)
    variable c : cluster_t;
  begin
    if rising_edge(clk) then
      read_valid <= ask;
      read_slot  <= ask_slot;
      slot_valid <= read_valid;
      slot       <= read_slot;
      if read_valid = '1' then
        c := to_cluster(memory_read);
        slot_cluster <= c;
        slot_near    <= '0';
        if x_high >= c.x_min and x_low <= c.x_max and y_low <= c.y_max then
          slot_near <= '1';
        end if;
        slot_enough <= '0';
        if c.green >= unsigned(cfg_min_pixels) then
          slot_enough <= '1';
        end if;
      end if;
      if rst = '1' then
        read_valid <= '0';
        slot_valid <= '0';
      end if;
    end if;
  end process;

  control_p : process (clk)
  begin
    if rising_edge(clk) then
      if ask = '1' then
        asked <= asked or one_hot(ask_slot);
      end if;

      case state is

        when S_CLEAR =>
          laser <= laser + 1;
          if laser = 2 ** G_LASER_BITS - 1 then
            state <= S_IDLE;
          end if;

        when S_IDLE =>
          laser            <= unsigned(in_laser);
          asked            <= (others => '0');
          freed            <= (others => '0');
          fewest           <= (others => '1');
          merged.pixels    <= resize(unsigned(in_pixels), COUNT_BITS);
          merged.green     <= resize(unsigned(in_green), COUNT_BITS);
          merged.saturated <= resize(unsigned(in_saturated), COUNT_BITS);
          merged.weight    <= resize(unsigned(in_weight), weight_t'length);
          merged.weight_x  <= resize(unsigned(in_weight_x), weight_x_t'length);
          merged.x_min     <= unsigned(in_x_min);
          merged.x_max     <= unsigned(in_x_max);
          merged.y_min     <= unsigned(in_y(y_t'range));
          merged.y_max     <= unsigned(in_y(y_t'range));
          merged.r_max     <= unsigned(in_r_max);
          rows             <= in_y;
          damaged          <= in_pixels;
          hits             <= in_hits;
          outside          <= in_outside;
          if in_valid = '1' then
            state <= S_PREPARE;
            if in_end = '1' then
              laser <= (others => '0');
              state <= S_READ;
            end if;
          end if;

        when S_PREPARE =>
          merged.weight_y <= resize(merged.weight(in_weight'range) * merged.y_max, weight_y_t'length);
          x_high          <= resize(merged.x_max, 12) + unsigned(cfg_cluster_gap);
          x_low           <= (others => '0');
          if merged.x_min > unsigned(cfg_cluster_gap) then
            x_low <= resize(merged.x_min, 12) - unsigned(cfg_cluster_gap);
          end if;
          y_low <= (others => '0');
          if merged.y_max > unsigned(cfg_cluster_gap) then
            y_low <= resize(merged.y_max, 12) - unsigned(cfg_cluster_gap);
          end if;
          state <= S_SCAN;

        when S_SCAN =>
          if slot_valid = '1' then
            if slot_near = '1' then
              freed            <= freed or one_hot(slot);
              merged.pixels    <= merged.pixels + slot_cluster.pixels;
              merged.green     <= merged.green + slot_cluster.green;
              merged.saturated <= merged.saturated + slot_cluster.saturated;
              merged.weight    <= merged.weight + slot_cluster.weight;
              merged.weight_x  <= merged.weight_x + slot_cluster.weight_x;
              merged.weight_y  <= merged.weight_y + slot_cluster.weight_y;
              if slot_cluster.x_min < merged.x_min then
                merged.x_min <= slot_cluster.x_min;
              end if;
              if slot_cluster.x_max > merged.x_max then
                merged.x_max <= slot_cluster.x_max;
              end if;
              if slot_cluster.y_min < merged.y_min then
                merged.y_min <= slot_cluster.y_min;
              end if;
              if slot_cluster.r_max > merged.r_max then
                merged.r_max <= slot_cluster.r_max;
              end if;
            elsif slot_cluster.pixels < fewest then
              fewest      <= slot_cluster.pixels;
              fewest_slot <= slot;
            end if;
          end if;
          if scanned = '1' then
            if free = (free'range => '0') then
              overflow <= overflow + fewest;
            end if;
            state <= S_IDLE;
          end if;

        when S_READ =>
          asked <= (others => '0');
          state <= S_GIVE;

        when S_GIVE =>
          if slot_valid = '1' and slot_enough = '1' then
            give <= '1';
          end if;
          if give = '1' and out_ready = '1' then
            give <= '0';
          end if;
          if scanned = '1' then
            laser <= laser + 1;
            state <= S_READ;
            if last_laser = '1' then
              state <= S_END;
            end if;
          end if;

        when S_END =>
          if out_ready = '1' then
            overflow <= (others => '0');
            state    <= S_IDLE;
          end if;

      end case;

      if rst = '1' then
        state    <= S_CLEAR;
        laser    <= (others => '0');
        overflow <= (others => '0');
        give     <= '0';
      end if;
    end if;
  end process;

  out_valid     <= '1' when give = '1' or state = S_END else '0';
  out_end       <= '1' when state = S_END else '0';
  out_laser     <= std_ulogic_vector(laser);
  out_pixels    <= hits when state = S_END else std_ulogic_vector(slot_cluster.pixels);
  out_saturated <= outside when state = S_END else std_ulogic_vector(slot_cluster.saturated);
  out_weight    <= std_ulogic_vector(slot_cluster.weight);
  out_weight_x  <= std_ulogic_vector(slot_cluster.weight_x);
  out_weight_y  <= std_ulogic_vector(slot_cluster.weight_y);
  out_x_min     <= std_ulogic_vector(slot_cluster.x_min);
  out_x_max     <= std_ulogic_vector(slot_cluster.x_max);
  out_y_min     <= std_ulogic_vector(slot_cluster.y_min);
  out_y_max     <= std_ulogic_vector(slot_cluster.y_max);
  out_r_max     <= std_ulogic_vector(slot_cluster.r_max);
  out_rows      <= rows;
  out_damaged   <= damaged;
  out_overflow  <= std_ulogic_vector(overflow);

end architecture;
