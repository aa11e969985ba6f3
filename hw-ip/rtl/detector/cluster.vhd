-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The candidate spots of every laser.
--
-- Purpose     joins runs to clusters whose boxes are within the gap, up to 2 ** G_SLOT_BITS per laser; with all slots taken
--             the cluster of the fewest pixels makes room. Closes clusters that no later run can reach while the frame goes
--             on, the rest at its end, and hands those with enough green pixels to centroid. At the end says which slots of
--             each laser hold a spot
-- Method      a cluster is a dozen words of one block memory. They go one per clock through one adder and comparison
-- Latency     a run takes 15 clocks if its laser has no open cluster; else 19 and 3 per open cluster, 22 more for each but
--             the first that it joins; with all slots taken, 16 and 2 per slot more. A visit to a laser takes 3 clocks, and
--             8 to 23 per open cluster. The end takes 1 clock per laser, at least 12
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
    word_laser         : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);          -- the cluster's laser, until the next one
    word_slot          : out std_ulogic_vector(G_SLOT_BITS - 1 downto 0);           -- the cluster's slot, until the next one
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
  constant WEIGHT_Y       : index_t := x"A";
  -- Other operands
  constant OF_LASER       : index_t := x"B";
  constant MIN_PIXELS     : index_t := x"C";
  constant HITS           : index_t := x"D";
  constant OUTSIDE        : index_t := x"E";
  constant OVERFLOWN      : index_t := x"F";

  constant NONE : mask_t := (others => '0');

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

  type state_t is (S_CLEAR, S_IDLE, S_LOOK, S_FLAGS, S_SCAN, S_WAIT, S_DECIDE, S_FEWEST, S_FEWEST_WAIT, S_MERGE, S_COPY, S_WALK);
  signal state : state_t;

  signal laser       : laser_t;
  signal visit_laser : laser_t;
  signal visits      : std_ulogic;  -- a visit is under way, not a run
  signal is_last_laser : std_ulogic;

  -- Slots of each laser: taken; not closed yet; closed with enough pixels
  type flags_memory_t is array (0 to 2 ** G_LASER_BITS - 1) of std_ulogic_vector(3 * SLOTS - 1 downto 0);
  signal flags_memory : flags_memory_t;
  signal flags_read   : std_ulogic_vector(3 * SLOTS - 1 downto 0);
  signal flags_write  : std_ulogic;
  signal flags_data   : std_ulogic_vector(3 * SLOTS - 1 downto 0);
  signal taken        : mask_t;
  signal unclosed     : mask_t;
  signal spots        : mask_t;

  signal all_closed   : std_ulogic;  -- the last round of visits has left nothing to close
  signal round_closed : std_ulogic;  -- nor has this one so far
  signal end_seen     : std_ulogic;  -- of the end of the frame that waits

  signal left        : mask_t;  -- slots still to be addressed
  signal left_after  : mask_t;
  signal this_slot   : mask_t;
  signal word        : index_t;
  signal pace        : std_ulogic;  -- every second clock, if the result of one word is an operand of the next
  signal paced       : std_ulogic;
  signal near        : mask_t;
  signal enough      : std_ulogic;
  signal closing     : mask_t;
  signal target      : mask_t;
  signal fewest_slot : mask_t;
  signal walked      : std_ulogic;  -- all lasers are
  signal copied      : std_ulogic;  -- all words are

  signal overflow    : unsigned(COUNT_BITS - 1 downto 0);
  signal product       : unsigned(G_X_BITS + G_Y_BITS + 9 downto 0);  -- weight times row
  signal product_held  : unsigned(G_X_BITS + G_Y_BITS + 9 downto 0);

  -- What is done with a word: its memory m, an operand b of the run
  type kind_t is (
    K_NEAR,      -- is the slot's box near, by this coordinate?
    K_ENOUGH,    -- are there enough green pixels?
    K_FEWEST,    -- the smaller one, and whose it is
    K_OVERFLOW,  -- the sum, as overflow
    K_MERGE,     -- smaller one, larger one or sum; to memory
    K_COPY,      -- m, or b of the words that are not in memory, to the output
    K_FRAME      -- b, as a word of the frame, to the output
  );

  type step_t is record
    valid   : std_ulogic;
    kind    : kind_t;
    word    : index_t;
    slot    : mask_t;
    first   : std_ulogic;  -- the operand comes from the run, not from the word before
    last    : std_ulogic;  -- the result is final
    only_b  : std_ulogic;  -- there is no m
  end record;
  type step_array_t is array (natural range <>) of step_t;

  -- 1: address; 2: memory's output; 3: operands; 4: sum and comparison; 5: result
  signal step_at : step_array_t(1 to 5);
  signal step    : step_t;
  signal operand_select    : index_t;
  signal operand_select_at : index_t;
  signal drained : std_ulogic;

  type memory_t is array (0 to 2 ** (G_LASER_BITS + G_SLOT_BITS + 4) - 1) of word_t;
  signal memory        : memory_t;
  signal read_address  : unsigned(G_LASER_BITS + G_SLOT_BITS + 3 downto 0);
  signal write_address : unsigned(G_LASER_BITS + G_SLOT_BITS + 3 downto 0);
  signal write_laser   : laser_t;
  signal memory_read   : word_t;

  type operands_t is array (0 to 15) of word_t;
  signal operands      : operands_t;
  signal selected      : word_t;
  signal selected_held : word_t;
  signal m           : word_t;
  signal m_held      : word_t;
  signal b           : word_t;
  signal b_or_result : word_t;
  signal b_held      : word_t;
  signal sum         : word_t;
  signal not_below   : std_ulogic;  -- m >= b
  signal negative    : std_ulogic;
  signal pick_m      : std_ulogic;
  signal pick_b      : std_ulogic;
  signal keep        : std_ulogic;
  signal result      : word_t;

begin

  spots    <= flags_read(3 * SLOTS - 1 downto 2 * SLOTS);
  unclosed <= flags_read(2 * SLOTS - 1 downto SLOTS);
  taken    <= flags_read(SLOTS - 1 downto 0);

  is_last_laser <= '1' when laser + 1 = unsigned(cfg_lasers(G_LASER_BITS - 1 downto 0)) else '0';

  this_slot  <= lowest(left);
  left_after <= left and not this_slot;

  drained <= not (step_at(1).valid or step_at(2).valid or step_at(3).valid or step_at(4).valid);

  -- The last operand of a run is on its way, or all of the frame
  in_ready <= '1' when (state = S_MERGE and pace = '0' and left_after = NONE and word = WEIGHT_Y)
                       or (state = S_WALK and walked = '1' and copied = '1') else '0';

  flags_write <= '1' when state = S_CLEAR or state = S_WALK
                          or (state = S_MERGE and word = WEIGHT_Y) or (state = S_DECIDE and visits = '1') else '0';

  -- What the visit closes
  closing <= this_slot when end_seen = '1' else this_slot and not near;

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

  control_p : process (clk)
    variable next_laser : laser_t;
  begin
    if rising_edge(clk) then
      pace       <= '0';
      mask_valid <= '0';

      if is_last_laser = '1' then
        next_laser := (others => '0');
      else
        next_laser := laser + 1;
      end if;

      case state is

        when S_CLEAR =>
          laser <= laser + 1;
          if laser = 2 ** G_LASER_BITS - 1 then
            state <= S_IDLE;
          end if;

        when S_IDLE =>
          walked <= '0';
          copied <= '0';
          word   <= X_MIN;
          visits <= '1';
          laser  <= visit_laser;
          if in_valid = '1' and in_end = '0' then
            visits <= '0';
            laser  <= unsigned(in_laser);
            state  <= S_LOOK;
          elsif in_valid = '1' and end_seen = '0' then
            end_seen     <= '1';
            visit_laser  <= (others => '0');
            round_closed <= '1';
          elsif drained = '1' and step_at(5).valid = '0' and words_ready = '1' then
            if all_closed = '0' then
              state <= S_LOOK;
            elsif in_valid = '1' then
              laser <= (others => '0');
              state <= S_WALK;
            end if;
          end if;

        when S_LOOK =>
          state <= S_FLAGS;

        when S_FLAGS =>
          left  <= unclosed;
          state <= S_SCAN;
          if visits = '0' then
            all_closed   <= '0';
            round_closed <= '0';
            if unclosed = NONE then
              state <= S_DECIDE;
            end if;
          else
            word <= Y_MAX;
            if unclosed = NONE then
              visit_laser <= next_laser;
              state       <= S_IDLE;
              if is_last_laser = '1' then
                all_closed   <= round_closed;
                round_closed <= '1';
              end if;
            end if;
          end if;

        when S_SCAN =>
          if visits = '1' then
            word <= GREEN;
            if word = GREEN then
              state <= S_WAIT;
            end if;
          else
            word <= word + 1;
            if word = Y_MAX then
              word <= X_MIN;
              left <= left_after;
              if left_after = NONE then
                state <= S_WAIT;
              end if;
            end if;
          end if;

        when S_WAIT =>
          if drained = '1' then
            state <= S_DECIDE;
          end if;

        when S_DECIDE =>
          word        <= X_MIN;
          left        <= near;
          paced       <= '0';
          if (near and std_ulogic_vector(unsigned(near) - 1)) /= NONE then
            paced <= '1';
          end if;
          write_laser <= laser;
          if visits = '0' then
            target <= lowest(near or not taken);
            state  <= S_MERGE;
            if near = NONE and taken = not NONE then
              left  <= taken;
              state <= S_FEWEST;
            end if;
          elsif closing = NONE then
            -- The cluster stays open
            word  <= Y_MAX;
            left  <= left_after;
            state <= S_SCAN;
            if left_after = NONE then
              round_closed <= '0';
              visit_laser  <= next_laser;
              state        <= S_IDLE;
              if is_last_laser = '1' then
                round_closed <= '1';
              end if;
            end if;
          else
            -- The visit to the laser is repeated: there may be more to close
            target <= this_slot;
            left   <= this_slot;
            state  <= S_IDLE;
            if enough = '1' then
              state <= S_COPY;
            end if;
          end if;

        when S_FEWEST =>
          pace <= not pace;
          if pace = '0' then
            left <= left_after;
            if left_after = NONE then
              pace  <= '0';
              state <= S_FEWEST_WAIT;
            end if;
          end if;

        when S_FEWEST_WAIT =>
          left   <= fewest_slot;
          target <= fewest_slot;
          pace   <= drained;
          if pace = '1' then
            pace  <= '0';
            left  <= NONE;
            state <= S_MERGE;
          end if;

        when S_MERGE =>
          pace <= paced and not pace;
          if pace = '0' then
            left <= left_after;
            if left_after = NONE then
              left <= near;
              word <= word + 1;
              if word = WEIGHT_Y then
                state <= S_IDLE;
              end if;
            end if;
          end if;

        when S_COPY =>
          word <= word + 1;
          if word = OF_LASER then
            state <= S_IDLE;
          end if;

        when S_WALK =>
          laser      <= next_laser;
          mask_valid <= not walked;
          mask_laser <= std_ulogic_vector(laser);
          mask_last  <= is_last_laser;
          walked     <= walked or is_last_laser;
          word       <= word + 1;
          if word = OF_LASER then
            copied <= '1';
          end if;
          if walked = '1' and copied = '1' then
            end_seen <= '0';
            state    <= S_IDLE;
          end if;

      end case;

      if rst = '1' then
        state        <= S_CLEAR;
        laser        <= (others => '0');
        visit_laser  <= (others => '0');
        all_closed   <= '0';
        round_closed <= '0';
        end_seen     <= '0';
        mask_valid   <= '0';
      end if;
    end if;
  end process;

  -- What the state does with a word
  step_p : process (all)
  begin
    step.valid  <= '0';
    step.kind   <= K_NEAR;
    step.word   <= word;
    step.slot   <= this_slot;
    step.first  <= '1';
    step.last   <= '1';
    step.only_b <= '0';
    operand_select <= word;
    case state is
      when S_CLEAR | S_IDLE | S_LOOK | S_FLAGS | S_WAIT | S_DECIDE =>
        null;
      when S_SCAN =>
        step.valid <= '1';
        -- x_min with x_max, x_max with x_min, y_max with y
        operand_select <= word xor x"1";
        if word = GREEN then
          step.kind      <= K_ENOUGH;
          operand_select <= MIN_PIXELS;
        end if;
      when S_FEWEST =>
        step.valid <= not pace;
        step.kind  <= K_FEWEST;
        step.word  <= PIXELS;
        if left /= taken then
          step.first <= '0';
        end if;
      when S_FEWEST_WAIT =>
        step.valid <= pace;
        step.kind  <= K_OVERFLOW;
        step.word  <= PIXELS;
        operand_select <= OVERFLOWN;
      when S_MERGE =>
        step.valid <= not pace;
        step.kind  <= K_MERGE;
        if left /= near then
          step.first <= '0';
        end if;
        if left_after /= NONE then
          step.last <= '0';
        end if;
        if near = NONE then
          step.only_b <= '1';
        end if;
      when S_COPY =>
        step.valid <= '1';
        step.kind  <= K_COPY;
      when S_WALK =>
        step.valid <= not copied;
        step.kind  <= K_FRAME;
        if word = X_MIN then
          operand_select <= OVERFLOWN;
        elsif word = RADIUS_SQUARED then
          operand_select <= Y_MAX;
        elsif word = PIXELS then
          operand_select <= HITS;
        elsif word = SATURATED then
          operand_select <= OUTSIDE;
        elsif word = OF_LASER then
          operand_select <= X_MIN;
        end if;
    end case;
  end process;

  steps_p : process (clk)
  begin
    if rising_edge(clk) then
      operand_select_at <= operand_select;
      step_at           <= step & step_at(1 to 4);
      if rst = '1' then
        for i in step_at'range loop
          step_at(i).valid <= '0';
        end loop;
      end if;
    end if;
  end process;

  read_address <= laser & number(step_at(1).slot) & step_at(1).word;

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      memory_read <= memory(to_integer(read_address));
      if step_at(5).valid = '1' and step_at(5).kind = K_MERGE and step_at(5).last = '1' then
        memory(to_integer(write_address)) <= result;
      end if;
    end if;
  end process;

  operands(0)  <= resize(unsigned(in_x_min), WORD_BITS);
  operands(1)  <= resize(unsigned(in_x_max), WORD_BITS);
  operands(2)  <= resize(unsigned(in_y), WORD_BITS);
  operands(3)  <= resize(unsigned(in_y), WORD_BITS);
  operands(4)  <= resize(unsigned(in_radius_squared), WORD_BITS);
  operands(5)  <= resize(unsigned(in_pixels), WORD_BITS);
  operands(6)  <= resize(unsigned(in_green), WORD_BITS);
  operands(7)  <= resize(unsigned(in_saturated), WORD_BITS);
  operands(8)  <= resize(unsigned(in_weight), WORD_BITS);
  operands(9)  <= resize(unsigned(in_weight_x), WORD_BITS);
  operands(10) <= resize(product_held, WORD_BITS);
  operands(11) <= resize(laser, WORD_BITS);
  operands(12) <= resize(unsigned(cfg_min_pixels), WORD_BITS);
  operands(13) <= resize(unsigned(in_hits), WORD_BITS);
  operands(14) <= resize(unsigned(in_outside), WORD_BITS);
  operands(15) <= resize(overflow, WORD_BITS);
  selected     <= operands(to_integer(operand_select_at));

  -- A run changes no faster than it is used: the product has time
  product_p : process (clk)
  begin
    if rising_edge(clk) then
      product      <= unsigned(in_weight) * unsigned(in_y(G_Y_BITS - 1 downto 0));
      product_held <= product;
    end if;
  end process;

  operands_p : process (clk)
    variable gap : box_t;
  begin
    if rising_edge(clk) then
      selected_held <= selected;
      -- x_max + gap + 1 against x_min; x_min - gap against x_max, y - gap against y_max
      gap := (others => '0');
      if step_at(2).kind = K_NEAR then
        gap := resize(unsigned(cfg_cluster_gap), BOX_BITS);
        if step_at(2).word = X_MIN then
          gap := not gap;
        end if;
      end if;
      m                         <= memory_read;
      b                         <= selected_held;
      b(BOX_BITS - 1 downto 0)  <= selected_held(BOX_BITS - 1 downto 0) - gap;
    end if;
  end process;

  b_or_result <= b when step_at(3).first = '1' else result;

  sum_p : process (clk)
  begin
    if rising_edge(clk) then
      m_held    <= m;
      b_held    <= b;
      negative  <= b(BOX_BITS - 1);
      sum       <= m + b_or_result;
      not_below <= '0';
      if m(COMPARE_BITS - 1 downto 0) >= b_or_result(COMPARE_BITS - 1 downto 0) then
        not_below <= '1';
      end if;
    end if;
  end process;

  pick_p : process (all)
  begin
    pick_m <= '0';
    pick_b <= '0';
    keep   <= '0';
    case step_at(4).kind is
      when K_NEAR | K_ENOUGH | K_OVERFLOW =>
        null;
      when K_FEWEST =>
        pick_m <= step_at(4).first or not not_below;
        keep   <= not step_at(4).first and not_below;
      when K_MERGE =>
        if step_at(4).only_b = '1' then
          pick_b <= '1';
        elsif step_at(4).word = X_MIN or step_at(4).word = Y_MIN then
          pick_m <= not not_below;
          pick_b <= not_below and step_at(4).first;
          keep   <= not_below and not step_at(4).first;
        elsif step_at(4).word <= RADIUS_SQUARED then
          pick_m <= not_below;
          pick_b <= not not_below and step_at(4).first;
          keep   <= not not_below and not step_at(4).first;
        end if;
      when K_COPY =>
        pick_m <= '1';
        if step_at(4).word = OF_LASER then
          pick_m <= '0';
          pick_b <= '1';
        end if;
      when K_FRAME =>
        pick_b <= '1';
    end case;
  end process;

  result_p : process (clk)
  begin
    if rising_edge(clk) then
      if step_at(4).valid = '1' and keep = '0' then
        result <= sum;
        if pick_m = '1' then
          result <= m_held;
        elsif pick_b = '1' then
          result <= b_held;
        end if;
      end if;
      write_address <= write_laser & number(target) & step_at(4).word;
      if state = S_FLAGS then
        near <= unclosed;
      end if;
      if step_at(4).valid = '1' then
        if step_at(4).kind = K_NEAR then
          if step_at(4).word = X_MIN then
            if not_below = '1' then
              near <= near and not step_at(4).slot;
            end if;
          elsif not_below = '0' and negative = '0' then
            near <= near and not step_at(4).slot;
          end if;
        end if;
        if step_at(4).kind = K_ENOUGH then
          enough <= not_below;
        end if;
        if step_at(4).kind = K_FEWEST and pick_m = '1' then
          fewest_slot <= step_at(4).slot;
        end if;
      end if;
      if step_at(5).valid = '1' and step_at(5).kind = K_OVERFLOW then
        overflow <= result(COUNT_BITS - 1 downto 0);
      end if;
      if rst = '1' or (state = S_WALK and walked = '1' and copied = '1') then
        overflow <= (others => '0');
      end if;
    end if;
  end process;

  word_valid <= '1' when step_at(5).valid = '1' and (step_at(5).kind = K_COPY or step_at(5).kind = K_FRAME) else '0';
  word_frame <= '1' when step_at(5).kind = K_FRAME else '0';
  word_last  <= '1' when step_at(5).word = OF_LASER else '0';
  word_index <= std_ulogic_vector(step_at(5).word);
  word_data  <= std_ulogic_vector(result);
  word_laser <= std_ulogic_vector(write_address(write_address'high downto G_SLOT_BITS + 4));
  word_slot  <= std_ulogic_vector(write_address(G_SLOT_BITS + 3 downto 4));
  mask_slots <= spots;

end architecture;
