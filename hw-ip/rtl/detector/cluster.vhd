-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The candidate spots of every laser.
--
-- Purpose     joins runs to clusters whose boxes are within the gap, up to 2 ** G_SLOT_BITS per laser; with all slots taken
--             the cluster of the fewest pixels makes room. Closes clusters that no later run can reach while the frame goes
--             on, the rest at its end, and hands those with enough green pixels to centroid. At the end says which slots of
--             each laser hold a spot
-- Method      a cluster is a dozen words of one block memory. They go one per clock through one adder and comparison
-- Latency     a run takes 18 clocks if its laser has no open cluster, else 24 and 3 per open cluster. If it joins several, a
--             word takes 6 clocks per cluster instead of 1; if one has to make room, 9 and 6 per slot more. A visit to a
--             laser takes 3 clocks and 9 per open cluster, 19 more if it goes to centroid; it begins 2 clocks after centroid
--             is ready for the next one. The end takes 1 clock per laser, at least 12, and 3 to the first laser's slots
-- Throughput  one run or visit per latency
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_core: Candidates::add, Cluster::merge, SpotDetector::spots

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity cluster is
  generic (
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this, not above the widest
    G_LASER_BITS : positive range 1 to 10 := 4;   -- most lasers: 2 ** this
    G_SLOT_BITS  : positive range 1 to 3 := 2     -- candidates per laser: 2 ** this
  );
  port (
    clk                : in  std_ulogic;                                        -- rising edge
    rst                : in  std_ulogic;                                        -- synchronous, high: forgets all clusters,
                                                                                -- which takes one clock per laser
    cfg_lasers         : in  std_ulogic_vector(G_LASER_BITS downto 0);          -- how many there are
    cfg_cluster_gap    : in  std_ulogic_vector(10 downto 0);                    -- DetectorConfig::cluster_gap; more than 2047
                                                                                -- is the same as 2047
    cfg_min_pixels     : in  std_ulogic_vector(15 downto 0);                    -- DetectorConfig::min_pixels
    in_valid           : in  std_ulogic;                                        -- run is there; all as the outputs of run
    in_ready           : out std_ulogic;                                        -- run is taken
    in_end             : in  std_ulogic;
    in_laser           : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    in_x_min           : in  std_ulogic_vector(G_X_BITS downto 0);
    in_x_max           : in  std_ulogic_vector(G_X_BITS - 1 downto 0);
    in_y               : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_pixels          : in  std_ulogic_vector(G_X_BITS downto 0);
    in_green           : in  std_ulogic_vector(G_X_BITS downto 0);
    in_saturated       : in  std_ulogic_vector(G_X_BITS downto 0);
    in_weight          : in  std_ulogic_vector(G_X_BITS + 9 downto 0);
    in_weight_x        : in  std_ulogic_vector(2 * G_X_BITS + 9 downto 0);
    in_radius_squared  : in  std_ulogic_vector(2 * G_X_BITS + 9 downto 0);
    in_hits            : in  std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
    in_outside         : in  std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
    word_valid         : out std_ulogic;                                            -- word of a cluster, or of the frame
    word_frame         : out std_ulogic;                                            -- of the frame
    word_last          : out std_ulogic;                                            -- the last one
    word_index         : out std_ulogic_vector(3 downto 0);                         -- which one: see centroid
    word_data          : out std_ulogic_vector(2 * G_X_BITS + G_Y_BITS + 9 downto 0);  -- the word
    word_laser         : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);          -- the cluster's laser, up to word 10
    word_slot          : out std_ulogic_vector(G_SLOT_BITS - 1 downto 0);           -- the cluster's slot, up to word 10
    words_ready        : in  std_ulogic;                                            -- words of a cluster or frame are welcome
    mask_valid         : out std_ulogic;                                            -- at the end, one laser per clock: slots
    mask_laser         : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);          -- of this laser
    mask_slots         : out std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);      -- that hold a spot
    mask_last          : out std_ulogic                                             -- the last laser
  );
end entity;

architecture rtl of cluster is

  constant SLOTS        : positive := 2 ** G_SLOT_BITS;
  constant COUNT_BITS   : positive := G_X_BITS + G_Y_BITS + 1;
  constant WORD_BITS    : positive := 2 * G_X_BITS + G_Y_BITS + 10;
  constant COMPARE_BITS : positive := 2 * G_X_BITS + 10;  -- of the words of which the smaller or larger is kept
  constant BOX_BITS     : positive := 13;                 -- of a coordinate and the gap, with a sign

  subtype word_t is unsigned(WORD_BITS - 1 downto 0);
  subtype box_t is unsigned(BOX_BITS - 1 downto 0);
  subtype laser_t is unsigned(G_LASER_BITS - 1 downto 0);
  subtype slot_t is unsigned(G_SLOT_BITS - 1 downto 0);
  subtype mask_t is std_ulogic_vector(SLOTS - 1 downto 0);
  subtype index_t is unsigned(3 downto 0);

  -- Words of a cluster, and of a run
  constant X_MIN          : index_t := x"0";
  constant X_MAX          : index_t := x"1";
  constant Y_MAX          : index_t := x"2";
  constant Y_MIN          : index_t := x"3";
  constant RADIUS_SQUARED : index_t := x"4";
  constant PIXELS         : index_t := x"5";
  constant GREEN          : index_t := x"6";
  constant SATURATED      : index_t := x"7";
  constant WEIGHT         : index_t := x"8";
  constant WEIGHT_X       : index_t := x"9";
  constant OF_LASER       : index_t := x"A";  -- means nothing in memory
  constant WEIGHT_Y       : index_t := x"B";  -- the last one

  constant NONE : mask_t := (others => '0');
  constant EACH : mask_t := (others => '1');

  -- The lowest bit of a mask that is set
  function lowest(mask : mask_t) return mask_t is
  begin
    return mask and std_ulogic_vector(unsigned(not mask) + 1);
  end function;

  function number(one_hot : mask_t) return slot_t is
    variable slot : slot_t := (others => '0');
  begin
    for i in one_hot'range loop
      if one_hot(i) = '1' then
        slot := slot or to_unsigned(i, G_SLOT_BITS);
      end if;
    end loop;
    return slot;
  end function;

  function several(mask : mask_t) return std_ulogic is
  begin
    return or (mask and std_ulogic_vector(unsigned(mask) - 1));
  end function;

  type state_t is (
    S_CLEAR,   -- after reset: the flags of one laser after the other
    S_IDLE,
    S_LOOK,    -- the laser's flags are read
    S_FLAGS,   -- they are there
    S_SCAN,    -- boxes of the open clusters against the run or the current row
    S_WAIT,    -- for the last result
    S_DECIDE,
    S_FEWEST,  -- all slots are taken: which cluster makes room?
    S_LOSE,    -- it goes
    S_MERGE,   -- run and near clusters to the target slot
    S_COPY,    -- cluster to centroid
    S_WALK,    -- the end: flags of one laser after the other, and the words of the frame
    S_NEXT     -- the run, or the end, is taken
  );
  signal state : state_t;

  signal visit_laser   : laser_t;
  signal visit_is_last : std_ulogic;
  signal last_laser    : laser_t;
  signal next_visit    : std_ulogic;  -- goes on to the next laser
  signal takes_run     : std_ulogic;
  signal takes_end     : std_ulogic;
  signal begins        : std_ulogic;  -- a visit, or the walk
  signal laser         : laser_t;
  signal laser_is_last : std_ulogic;
  signal visits        : std_ulogic;  -- a visit is under way, not a run

  -- Slots of each laser: taken; not closed yet; closed with enough pixels
  type flags_memory_t is array (0 to 2 ** G_LASER_BITS - 1) of std_ulogic_vector(3 * SLOTS - 1 downto 0);
  signal flags_memory : flags_memory_t;
  signal flags_read   : std_ulogic_vector(3 * SLOTS - 1 downto 0);
  signal flags_write  : std_ulogic;
  signal flags_data   : std_ulogic_vector(3 * SLOTS - 1 downto 0);
  signal taken        : mask_t;
  signal unclosed     : mask_t;
  signal spots        : mask_t;

  signal all_closed   : std_ulogic;  -- the last round of visits has left nothing to close; the next one starts at laser 0
  signal round_closed : std_ulogic;  -- nor has this one so far
  signal end_seen     : std_ulogic;  -- of the end of the frame that waits

  signal left        : mask_t;       -- slots still to be addressed
  signal left_after  : mask_t;
  signal is_one_left : std_ulogic;   -- or none
  signal is_full     : std_ulogic;   -- all slots are taken
  signal stays_open  : std_ulogic;   -- the visited cluster does
  signal this_slot   : mask_t;
  signal word        : index_t;
  signal go          : std_ulogic;   -- the result of the word before is there, if it is an operand
  signal near        : mask_t;
  signal joins       : std_ulogic;   -- several clusters are near
  signal enough      : std_ulogic;
  signal closing     : mask_t;
  signal target      : mask_t;
  signal walked      : std_ulogic;   -- all lasers are
  signal copied      : std_ulogic;   -- all words of the frame are
  signal copies      : std_ulogic;   -- words are on their way to centroid
  signal may_copy    : std_ulogic;   -- words are welcome

  signal overflow     : unsigned(COUNT_BITS - 1 downto 0);
  signal product      : unsigned(G_X_BITS + G_Y_BITS + 9 downto 0);  -- weight times row
  signal product_step : std_ulogic;
  signal row_bits     : std_ulogic_vector(15 downto 0);
  signal row_bit      : std_ulogic;                                  -- of the last word
  signal row_step     : std_ulogic;                                  -- it counts
  signal weight_or_zero : unsigned(G_X_BITS + 9 downto 0);

  -- Where operands come from
  type source_t is (FROM_RUN, FROM_BOX, FROM_FRAME, FROM_BEFORE);

  -- What is done with a word: its memory m, an operand b
  type step_t is record
    valid  : std_ulogic;
    near   : std_ulogic;  -- is the slot's box near, by this coordinate?
    enough : std_ulogic;  -- are there enough green pixels?
    fewest : std_ulogic;  -- the smaller one, and whose it is
    merge  : std_ulogic;  -- smaller one, larger one or sum; to memory
    copy   : std_ulogic;  -- m, or b of the word that is not in memory, to the output
    frame  : std_ulogic;  -- b, as a word of the frame, to the output
    only_b : std_ulogic;  -- there is no m
    only_m : std_ulogic;  -- there is no b
    last   : std_ulogic;  -- the result is final
    source : source_t;    -- where b comes from
    word   : index_t;
    slot   : mask_t;
  end record;
  type step_array_t is array (natural range <>) of step_t;

  constant NO_STEP : step_t := (
    source => FROM_RUN, word => (others => '0'), slot => (others => '0'), others => '0'
  );

  -- 1: address; 2, 3: memory's output; 4: operands; 5: comparison; 6: chosen operands; 7: result
  signal step    : step_t;
  signal step_at : step_array_t(1 to 7);
  signal drained : std_ulogic;  -- nothing is in 1 to 5: an operand from here is the last result
  signal emptied : std_ulogic;  -- nor in 6 and 7: the last result is there

  type memory_t is array (0 to 2 ** (G_LASER_BITS + G_SLOT_BITS + 4) - 1) of word_t;
  signal memory        : memory_t;
  signal read_address  : unsigned(G_LASER_BITS + G_SLOT_BITS + 3 downto 0);
  signal write_next    : unsigned(G_LASER_BITS + G_SLOT_BITS - 1 downto 0);
  signal write_address : unsigned(G_LASER_BITS + G_SLOT_BITS - 1 downto 0);  -- without the word
  signal write_laser   : laser_t;
  signal memory_read   : word_t;
  signal memory_held   : word_t;

  -- Operands: words of a run, and more
  constant MIN_PIXELS    : natural := 2;
  constant HITS          : natural := 12;
  constant OUTSIDE       : natural := 13;
  constant OVERFLOW_LOW  : natural := 14;
  constant OVERFLOW_HIGH : natural := 15;
  constant BEFORE        : natural := 16;
  constant RIGHT_END     : natural := 17;  -- what is near does not start to the right of this
  constant LEFT_END      : natural := 18;  -- nor end to the left of this
  constant TOP_END       : natural := 19;  -- nor above this
  type operands_t is array (0 to TOP_END) of word_t;
  signal operand       : operands_t;
  signal operand_drop  : std_ulogic_vector(0 to TOP_END);
  signal operand_held  : operands_t;  -- all but one of them are zero
  signal right_bound   : box_t;       -- behind the right end
  signal left_bound    : box_t;
  signal top_bound     : box_t;
  signal selected      : word_t;
  signal m             : word_t;
  signal m_held        : word_t;
  signal m_chosen      : word_t;
  signal b             : word_t;
  signal b_held        : word_t;
  signal b_chosen      : word_t;
  signal not_below     : std_ulogic;  -- m >= b
  signal negative      : std_ulogic;  -- b is
  signal keeps_smaller : std_ulogic;
  signal keeps_larger  : std_ulogic;
  signal drop_m        : std_ulogic;
  signal drop_b        : std_ulogic;
  signal result        : word_t;

begin

  spots    <= flags_read(3 * SLOTS - 1 downto 2 * SLOTS);
  unclosed <= flags_read(2 * SLOTS - 1 downto SLOTS);
  taken    <= flags_read(SLOTS - 1 downto 0);

  visit_is_last <= '1' when visit_laser = last_laser else '0';

  this_slot  <= lowest(left);
  left_after <= left and not this_slot;

  go <= drained or not (joins or step.fewest);

  flags_write <= '1' when state = S_CLEAR or state = S_WALK
                          or (state = S_MERGE and word = WEIGHT_Y) or (state = S_DECIDE and visits = '1') else '0';

  -- What the visit closes
  closing <= NONE when stays_open = '1' else this_slot;

  flags_p : process (all)
  begin
    if state = S_CLEAR or state = S_WALK then
      flags_data <= (others => '0');
    elsif visits = '1' then
      flags_data <= spots & (unclosed and not closing) & taken;
      if enough = '1' then
        flags_data <= (spots or closing) & (unclosed and not closing) & taken;
      end if;
    else
      flags_data <= (spots and not target) & ((unclosed and not near) or target) & ((taken and not near) or target);
    end if;
  end process;

  flags_memory_p : process (clk)
  begin
    if rising_edge(clk) then
      flags_read <= flags_memory(to_integer(laser));
      if flags_write = '1' then
        flags_memory(to_integer(laser)) <= flags_data;
      end if;
    end if;
  end process;

  is_one_left <= not several(left);

  -- What happens in S_IDLE, and where the next laser is visited
  takes_run  <= in_valid and not in_end;
  takes_end  <= in_valid and in_end and not end_seen;
  begins     <= may_copy and not takes_run and not takes_end and (not all_closed or in_valid);
  next_visit <= '1' when (state = S_IDLE and begins = '1' and all_closed = '1') or state = S_WALK
                         or (state = S_FLAGS and visits = '1' and unclosed = NONE)
                         or (state = S_DECIDE and visits = '1' and stays_open = '1' and is_one_left = '1') else '0';

  state_p : process (clk)
  begin
    if rising_edge(clk) then
      case state is

        when S_CLEAR =>
          if walked = '1' then
            state <= S_IDLE;
          end if;

        when S_IDLE =>
          if takes_run = '1' then
            state <= S_LOOK;
          elsif begins = '1' then
            state <= S_LOOK;
            if all_closed = '1' then
              state <= S_WALK;
            end if;
          end if;

        when S_LOOK =>
          state <= S_FLAGS;

        when S_FLAGS =>
          state <= S_SCAN;
          if unclosed = NONE then
            state <= S_DECIDE;
            if visits = '1' then
              state <= S_IDLE;
            end if;
          end if;

        when S_SCAN =>
          if (visits = '1' and word = GREEN) or (visits = '0' and word = Y_MAX and is_one_left = '1') then
            state <= S_WAIT;
          end if;

        when S_WAIT =>
          if drained = '1' then
            state <= S_DECIDE;
          end if;

        when S_DECIDE =>
          if visits = '0' then
            state <= S_MERGE;
            if near = NONE and is_full = '1' then
              state <= S_FEWEST;
            end if;
          elsif stays_open = '1' then
            state <= S_SCAN;
            if is_one_left = '1' then
              state <= S_IDLE;
            end if;
          else
            -- The visit to the laser is repeated: there may be more to close
            state <= S_IDLE;
            if enough = '1' then
              state <= S_COPY;
            end if;
          end if;

        when S_FEWEST =>
          if go = '1' and is_one_left = '1' then
            state <= S_LOSE;
          end if;

        when S_LOSE =>
          if emptied = '1' then
            state <= S_MERGE;
          end if;

        when S_MERGE =>
          if go = '1' and is_one_left = '1' and word = WEIGHT_Y then
            state <= S_NEXT;
          end if;

        when S_COPY =>
          if word = WEIGHT_Y then
            state <= S_IDLE;
          end if;

        when S_WALK =>
          if walked = '1' and copied = '1' then
            state <= S_NEXT;
          end if;

        when S_NEXT =>
          state <= S_IDLE;

      end case;
      if rst = '1' then
        state <= S_CLEAR;
      end if;
    end if;
  end process;

  in_ready <= '1' when state = S_NEXT else '0';

  -- One register after the other, not one state after the other: it takes fewer levels of LUTs
  lasers_p : process (clk)
  begin
    if rising_edge(clk) then
      last_laser <= unsigned(cfg_lasers(G_LASER_BITS - 1 downto 0)) - 1;
      mask_valid <= '0';
      if state = S_WALK and walked = '0' then
        mask_valid <= '1';
      end if;
      mask_laser <= std_ulogic_vector(laser);
      mask_last  <= laser_is_last;
      if next_visit = '1' or (state = S_CLEAR and walked = '0') then
        visit_laser <= visit_laser + 1;
      end if;
      if (next_visit = '1' and visit_is_last = '1') or (state = S_IDLE and takes_end = '1') then
        visit_laser <= (others => '0');
      end if;
      if state = S_IDLE or state = S_WALK or state = S_CLEAR then
        laser         <= visit_laser;
        laser_is_last <= visit_is_last;
        if state = S_IDLE and takes_run = '1' then
          laser <= unsigned(in_laser);
        end if;
      end if;
      if state = S_IDLE then
        visits <= not takes_run;
        walked <= '0';
      end if;
      if state = S_CLEAR and and visit_laser = '1' then
        walked <= '1';
      end if;
      if state = S_WALK and laser_is_last = '1' then
        walked <= '1';
      end if;
      if state = S_NEXT then
        end_seen <= '0';
      end if;
      if state = S_IDLE and takes_end = '1' then
        end_seen     <= '1';
        round_closed <= '1';
      end if;
      if state = S_FLAGS then
        if visits = '0' then
          all_closed   <= '0';
          round_closed <= '0';
        elsif unclosed = NONE and laser_is_last = '1' then
          all_closed   <= round_closed;
          round_closed <= '1';
        end if;
      end if;
      if state = S_DECIDE and visits = '1' and stays_open = '1' and is_one_left = '1' then
        round_closed <= laser_is_last;
      end if;
      if rst = '1' then
        walked       <= '0';
        visit_laser  <= (others => '0');
        all_closed   <= '0';
        round_closed <= '0';
        end_seen     <= '0';
        mask_valid   <= '0';
      end if;
    end if;
  end process;

  slots_p : process (clk)
  begin
    if rising_edge(clk) then
      is_full    <= and taken;
      joins      <= several(near);
      stays_open <= not end_seen and or (this_slot and near);
      if state = S_FLAGS then
        left <= unclosed;
      end if;
      if (state = S_SCAN and visits = '0' and word = Y_MAX) or (state = S_FEWEST and go = '1')
        or (state = S_DECIDE and visits = '1' and stays_open = '1') then
        left <= left_after;
      end if;
      if state = S_DECIDE and visits = '0' then
        left <= near;
        if near = NONE and is_full = '1' then
          left <= EACH;
        end if;
      end if;
      if state = S_MERGE and go = '1' then
        left <= left_after;
        if is_one_left = '1' then
          left <= near;
        end if;
      end if;
      if state = S_DECIDE then
        write_laser <= laser;
        target      <= lowest(near or not taken);
        if visits = '1' then
          target <= this_slot;
        end if;
      elsif step_at(5).valid = '1' and step_at(5).fewest = '1' and (step_at(5).only_m = '1' or not_below = '0') then
        target <= step_at(5).slot;
      end if;
    end if;
  end process;

  words_p : process (clk)
  begin
    if rising_edge(clk) then
      if state = S_IDLE then
        copied <= '0';
        word   <= X_MIN;
      end if;
      if (state = S_SCAN and visits = '0') or state = S_COPY or state = S_WALK
        or (state = S_MERGE and go = '1' and is_one_left = '1') then
        word <= word + 1;
      end if;
      if state = S_SCAN and visits = '0' and word = Y_MAX then
        word <= X_MIN;
      end if;
      if state = S_FLAGS and visits = '1' then
        word <= Y_MAX;
      end if;
      if state = S_SCAN and visits = '1' then
        word <= GREEN;
      end if;
      if state = S_DECIDE then
        word <= X_MIN;
        if visits = '1' and stays_open = '1' then
          word <= Y_MAX;
        end if;
      end if;
      if state = S_WALK and word = WEIGHT_Y then
        copied <= '1';
      end if;
      may_copy <= words_ready and not copies;
      if word_valid = '1' and word_last = '1' then
        copies <= '0';
      end if;
      if step.copy = '1' or step.frame = '1' then
        copies <= '1';
      end if;
      if rst = '1' then
        copies <= '0';
      end if;
    end if;
  end process;

  -- What the state does with a word
  step_p : process (all)
  begin
    step.near   <= '0';
    step.enough <= '0';
    step.fewest <= '0';
    step.merge  <= '0';
    step.copy   <= '0';
    step.frame  <= '0';
    step.source <= FROM_RUN;
    step.only_b <= '0';
    step.only_m <= '0';
    step.last   <= '0';
    step.word   <= word;
    step.slot   <= this_slot;
    if state = S_SCAN then
      step.source <= FROM_BOX;
      step.near   <= not word(2);
      step.enough <= word(2);
    end if;
    if state = S_FEWEST then
      step.fewest <= '1';
      step.source <= FROM_BEFORE;
      step.word   <= PIXELS;
      if left = EACH then
        step.only_m <= '1';
      end if;
    end if;
    if state = S_MERGE then
      step.merge <= '1';
      if left /= near then
        step.source <= FROM_BEFORE;
      end if;
      if is_one_left = '1' then
        step.last <= go;
      end if;
      if near = NONE then
        step.only_b <= '1';
      end if;
    end if;
    if state = S_COPY then
      step.copy <= '1';
      if word = OF_LASER then
        step.only_b <= '1';
      else
        step.only_m <= '1';
      end if;
    end if;
    if state = S_WALK then
      step.source <= FROM_FRAME;
      step.frame  <= not copied;
      step.only_b <= '1';
    end if;
  end process;

  step.valid <= step.near or step.enough or step.copy or step.frame or ((step.fewest or step.merge) and go);

  steps_p : process (clk)
  begin
    if rising_edge(clk) then
      step_at <= step & step_at(1 to 6);
      drained <= not (step.valid or step_at(1).valid or step_at(2).valid or step_at(3).valid or step_at(4).valid);
      emptied <= not (step.valid or step_at(1).valid or step_at(2).valid or step_at(3).valid or step_at(4).valid
                      or step_at(5).valid or step_at(6).valid);
      -- All of it: yosys would take LUTs as shift registers for what is not reset
      if rst = '1' then
        for i in step_at'range loop
          step_at(i) <= NO_STEP;
        end loop;
      end if;
    end if;
  end process;

  read_address <= laser & number(step_at(1).slot) & step_at(1).word;

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      -- What is written is some words behind what is read. Without the condition, which is always met, the tools guard
      -- against the same address on both sides
      if step_at(7).last = '0' or step_at(1).word /= step_at(7).word then
        memory_read <= memory(to_integer(read_address));
      end if;
      if step_at(7).last = '1' then
        memory(to_integer(write_address & step_at(7).word)) <= result;
      end if;
    end if;
  end process;

  operand(to_integer(X_MIN))          <= resize(unsigned(in_x_min), WORD_BITS);
  operand(to_integer(X_MAX))          <= resize(unsigned(in_x_max), WORD_BITS);
  operand(MIN_PIXELS)                 <= resize(unsigned(cfg_min_pixels), WORD_BITS);
  operand(to_integer(Y_MIN))          <= resize(unsigned(in_y), WORD_BITS);
  operand(to_integer(RADIUS_SQUARED)) <= resize(unsigned(in_radius_squared), WORD_BITS);
  operand(to_integer(PIXELS))         <= resize(unsigned(in_pixels), WORD_BITS);
  operand(to_integer(GREEN))          <= resize(unsigned(in_green), WORD_BITS);
  operand(to_integer(SATURATED))      <= resize(unsigned(in_saturated), WORD_BITS);
  operand(to_integer(WEIGHT))         <= resize(unsigned(in_weight), WORD_BITS);
  operand(to_integer(WEIGHT_X))       <= resize(unsigned(in_weight_x), WORD_BITS);
  operand(to_integer(WEIGHT_Y))       <= resize(product, WORD_BITS);
  operand(to_integer(OF_LASER))       <= resize(laser, WORD_BITS);
  operand(HITS)                       <= resize(unsigned(in_hits), WORD_BITS);
  operand(OUTSIDE)                    <= resize(unsigned(in_outside), WORD_BITS);
  operand(OVERFLOW_LOW)               <= resize(overflow, WORD_BITS);
  operand(OVERFLOW_HIGH)              <= resize(shift_right(overflow, 16), WORD_BITS);
  operand(BEFORE)                     <= result;
  operand(RIGHT_END)                  <= resize(right_bound, WORD_BITS);
  operand(LEFT_END)                   <= resize(left_bound, WORD_BITS);
  operand(TOP_END)                    <= resize(top_bound, WORD_BITS);

  bounds_p : process (clk)
    variable gap : box_t;
  begin
    if rising_edge(clk) then
      gap         := resize(unsigned(cfg_cluster_gap), BOX_BITS);
      right_bound <= resize(unsigned(in_x_max), BOX_BITS) - not gap;  -- plus the gap and one
      left_bound  <= resize(unsigned(in_x_min), BOX_BITS) - gap;
      top_bound   <= resize(unsigned(in_y), BOX_BITS) - gap;
    end if;
  end process;

  operand_p : process (clk)
    variable wanted : std_ulogic_vector(0 to TOP_END);
    variable at     : natural range 0 to 15;
  begin
    if rising_edge(clk) then
      at     := to_integer(step_at(1).word);
      wanted := (others => '0');
      case step_at(1).source is
        when FROM_RUN =>
          case at is
            when 0 | 1 | 3 | 4 | 5 | 6 | 7 | 8 | 9 | 10 | 11 => wanted(at) := '1';
            when 2 => wanted(3) := '1';
            when 12 | 13 | 14 | 15 => null;
          end case;
        when FROM_BOX =>
          case at is
            when 0 => wanted(RIGHT_END) := '1';
            when 1 => wanted(LEFT_END) := '1';
            when 2 => wanted(TOP_END) := '1';
            when 6 => wanted(MIN_PIXELS) := '1';
            when 3 | 4 | 5 | 7 | 8 | 9 | 10 | 11 | 12 | 13 | 14 | 15 => null;
          end case;
        when FROM_FRAME =>
          case at is
            when 0  => wanted(OVERFLOW_LOW) := '1';
            when 1  => wanted(OVERFLOW_HIGH) := '1';
            when 4  => wanted(3) := '1';
            when 5  => wanted(HITS) := '1';
            when 7  => wanted(OUTSIDE) := '1';
            when 10 => wanted(0) := '1';
            when 2 | 3 | 6 | 8 | 9 | 11 | 12 | 13 | 14 | 15 => null;
          end case;
        when FROM_BEFORE =>
          wanted(BEFORE) := '1';
      end case;
      operand_drop <= not wanted;
    end if;
  end process;

  -- A choice by the resets of registers: it takes fewer LUTs than one by multiplexers
  select_p : process (clk)
  begin
    if rising_edge(clk) then
      for i in operand'range loop
        operand_held(i) <= operand(i);
        if operand_drop(i) = '1' then
          operand_held(i) <= (others => '0');
        end if;
      end loop;
    end if;
  end process;

  selected_p : process (all)
    variable any : word_t;
  begin
    any := (others => '0');
    for i in operand_held'range loop
      any := any or operand_held(i);
    end loop;
    selected <= any;
  end process;

  -- Weight times row, one bit of the row per word: complete when it is needed
  row_bits <= std_ulogic_vector(resize(unsigned(in_y(G_Y_BITS - 1 downto 0)), 16));

  product_p : process (clk)
  begin
    if rising_edge(clk) then
      row_bit  <= row_bits(to_integer(word));
      row_step <= '0';
      if state = S_MERGE and go = '1' and is_one_left = '1' and word < G_Y_BITS then
        row_step <= '1';
      end if;
      product_step   <= row_step;
      weight_or_zero <= unsigned(in_weight);
      if row_bit = '0' then
        weight_or_zero <= (others => '0');
      end if;
      if state = S_DECIDE then
        product <= (others => '0');
      elsif product_step = '1' then
        product <= (resize(product(product'high downto G_Y_BITS), G_X_BITS + 11) + weight_or_zero)
                   & product(G_Y_BITS - 1 downto 1);
      end if;
    end if;
  end process;

  operands_p : process (clk)
  begin
    if rising_edge(clk) then
      memory_held <= memory_read;
      m           <= memory_held;
      b           <= selected;
    end if;
  end process;

  compare_p : process (clk)
  begin
    if rising_edge(clk) then
      m_held    <= m;
      if rst = '1' then
        m_held <= (others => '0');
      end if;
      b_held    <= b;
      negative  <= b(BOX_BITS - 1);
      not_below <= '0';
      if m(COMPARE_BITS - 1 downto 0) >= b(COMPARE_BITS - 1 downto 0) then
        not_below <= '1';
      end if;
      keeps_smaller <= '0';
      keeps_larger  <= '0';
      if step_at(4).only_b = '0' and step_at(4).only_m = '0' then
        if step_at(4).fewest = '1' or (step_at(4).merge = '1' and (step_at(4).word = X_MIN or step_at(4).word = Y_MIN)) then
          keeps_smaller <= '1';
        elsif step_at(4).word <= RADIUS_SQUARED then
          keeps_larger <= '1';
        end if;
      end if;
    end if;
  end process;

  -- The result is m, b or their sum
  drop_m <= step_at(5).only_b or (keeps_smaller and not_below) or (keeps_larger and not not_below);
  drop_b <= step_at(5).only_m or (keeps_smaller and not not_below) or (keeps_larger and not_below);

  result_p : process (clk)
  begin
    if rising_edge(clk) then
      m_chosen <= m_held;
      if drop_m = '1' then
        m_chosen <= (others => '0');
      end if;
      b_chosen <= b_held;
      if drop_b = '1' then
        b_chosen <= (others => '0');
      end if;
      if step_at(6).valid = '1' then
        result <= m_chosen + b_chosen;
      end if;
      write_next    <= write_laser & number(target);
      write_address <= write_next;
      if state = S_FLAGS then
        near <= unclosed;
      elsif step_at(5).near = '1' then
        if step_at(5).word(1 downto 0) = 0 then
          if not_below = '1' then
            near <= near and not step_at(5).slot;
          end if;
        elsif not_below = '0' and negative = '0' then
          near <= near and not step_at(5).slot;
        end if;
      end if;
      if step_at(5).enough = '1' then
        enough <= not_below;
      end if;
      if state = S_LOSE and emptied = '1' then
        overflow <= overflow + result(COUNT_BITS - 1 downto 0);
      end if;
      if rst = '1' or (state = S_WALK and walked = '1' and copied = '1') then
        overflow <= (others => '0');
      end if;
    end if;
  end process;

  word_valid <= step_at(7).copy or step_at(7).frame;
  word_frame <= step_at(7).frame;
  word_last  <= '1' when step_at(7).word = WEIGHT_Y else '0';
  word_index <= std_ulogic_vector(step_at(7).word);
  word_data  <= std_ulogic_vector(result);
  word_laser <= std_ulogic_vector(write_address(write_address'high downto G_SLOT_BITS));
  word_slot  <= std_ulogic_vector(write_address(G_SLOT_BITS - 1 downto 0));
  mask_slots <= spots;

end architecture;
