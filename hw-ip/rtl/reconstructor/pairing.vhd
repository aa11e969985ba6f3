-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Walks the lasers of a frame and gives the pairs of spots that are tried, one per clock.
--
-- Purpose     weighted: every pair of the two cameras' spots, camera 2 fastest, then, if a camera alone may do, every spot
--             of camera 1 and of camera 2. Paper: the farthest spots' pair, then each of the two. A laser without any
--             pair gets one that uses no spot
-- Latency     2 from start to the first pair, while hold is low; then a pair on every clock until the last one
-- Throughput  one pair per clock
-- Resources   about 100 registers
-- Twin        karst_core's reconstruct.rs: Candidates

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity pairing is
  generic (
    G_SLOT_BITS : positive range 1 to 3 := 2      -- slots of a laser: 2 ** this
  );
  port (
    clk           : in  std_ulogic;                                        -- rising edge
    rst           : in  std_ulogic;                                        -- synchronous, high: forgets what is under way
    paper         : in  std_ulogic;                                        -- the paper's method, constant
    single_camera : in  std_ulogic;                                        -- one camera alone may give a point, constant
    -- Frames
    start         : in  std_ulogic;                                        -- walk a bank; only if ready
    start_bank    : in  std_ulogic;                                        -- which one
    lasers        : in  unsigned(10 downto 0);                             -- how many of its lasers, at least 1
    ready         : out std_ulogic;                                        -- the last pair has been given
    hold          : in  std_ulogic_vector(1 downto 0);                     -- the bank of this number is not complete yet
    -- Candidates of the next laser
    read_bank     : out std_ulogic;                                        -- which laser's are wanted one clock later
    read_laser    : out unsigned(9 downto 0);
    slots_1       : in  std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);  -- slots with a spot of camera 1
    slots_2       : in  std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);  -- slots with a spot of camera 2
    farthest_1    : in  unsigned(G_SLOT_BITS - 1 downto 0);                -- the farthest of camera 1's
    farthest_2    : in  unsigned(G_SLOT_BITS - 1 downto 0);                -- the farthest of camera 2's
    -- Pairs
    out_valid     : out std_ulogic;                                        -- a pair is there
    out_first     : out std_ulogic;                                        -- the first of its laser
    out_last      : out std_ulogic;                                        -- the last of its laser
    out_end       : out std_ulogic;                                        -- of the last laser
    out_bank      : out std_ulogic;                                        -- the bank
    out_laser     : out unsigned(9 downto 0);                              -- the laser
    out_has       : out std_ulogic_vector(1 downto 0);                     -- cameras with spots: camera 1 (bit 0), camera 2
    out_used      : out std_ulogic_vector(1 downto 0);                     -- cameras in this pair
    out_slot_1    : out unsigned(G_SLOT_BITS - 1 downto 0);                -- slot of camera 1's spot
    out_slot_2    : out unsigned(G_SLOT_BITS - 1 downto 0);                -- slot of camera 2's spot
    out_spot_1    : out unsigned(2 downto 0);                              -- its number among camera 1's spots
    out_spot_2    : out unsigned(2 downto 0)                               -- its number among camera 2's spots
  );
end entity;

architecture rtl of pairing is

  subtype mask_t   is std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);
  subtype slot_t   is unsigned(G_SLOT_BITS - 1 downto 0);
  subtype number_t is unsigned(2 downto 0);
  type phase_t     is (IDLE, BOTH, FIRST_ALONE, SECOND_ALONE, NOTHING);

  function lowest(mask : mask_t) return slot_t is
    variable slot : slot_t := (others => '0');
  begin
    for i in mask'high downto 0 loop
      if mask(i) = '1' then
        slot := to_unsigned(i, G_SLOT_BITS);
      end if;
    end loop;
    return slot;
  end function;

  function without_lowest(mask : mask_t) return mask_t is
  begin
    return mask and std_ulogic_vector(unsigned(mask) - 1);
  end function;

  -- The spot's number, if it is in the mask
  function ones_below(mask : mask_t; slot : slot_t) return number_t is
    variable count : number_t := (others => '0');
  begin
    for i in 0 to mask'high - 1 loop
      if mask(i) = '1' and slot > i then
        count := count + 1;
      end if;
    end loop;
    return count;
  end function;

  function only(mask : mask_t; slot : slot_t) return mask_t is
    variable one : mask_t := (others => '0');
  begin
    for i in mask'range loop
      if slot = i then
        one(i) := mask(i);
      end if;
    end loop;
    return one;
  end function;

  -- The frame
  signal walking    : std_ulogic;             -- lasers are left
  signal bank       : std_ulogic;
  signal next_laser : unsigned(9 downto 0);   -- the laser whose candidates are at the inputs
  signal left       : unsigned(10 downto 0);  -- lasers from this one on
  signal held       : std_ulogic;             -- the bank is not complete
  signal take       : std_ulogic;             -- its pairs are the next

  -- The laser
  signal phase           : phase_t;
  signal ends            : std_ulogic;  -- this is its last pair
  signal all_1, all_2    : mask_t;      -- slots to go through
  signal rest_1, rest_2  : mask_t;      -- from this pair on
  signal base_1, base_2  : number_t;    -- number of the first of them
  signal spot_1, spot_2  : number_t;
  signal more_1, more_2  : std_ulogic;
  signal alone           : std_ulogic;

begin

  alone  <= paper or single_camera;
  more_1 <= or without_lowest(rest_1);
  more_2 <= or without_lowest(rest_2);

  with phase select ends <=
    not (more_1 or more_2 or alone) when BOTH,
    not more_1 and not out_has(1)   when FIRST_ALONE,
    not more_2                      when SECOND_ALONE,
    '1'                             when NOTHING | IDLE;

  held  <= hold(1) when bank = '1' else hold(0);
  ready <= '1' when phase = IDLE and walking = '0' else '0';
  take  <= walking and ends and not held;

  -- While nothing is walked, the first laser of the bank that start would name
  read_bank  <= bank when walking = '1' else start_bank;
  read_laser <= (others => '0') when walking = '0' else next_laser + 1 when take = '1' else next_laser;

  out_valid  <= '0' when phase = IDLE else '1';
  out_last   <= ends;
  out_slot_1 <= lowest(rest_1);
  out_slot_2 <= lowest(rest_2);
  out_spot_1 <= spot_1;
  out_spot_2 <= spot_2;
  with phase select out_used <=
    "11" when BOTH,
    "01" when FIRST_ALONE,
    "10" when SECOND_ALONE,
    "00" when NOTHING | IDLE;

  walk_p : process (clk)
    variable has : std_ulogic_vector(1 downto 0);
  begin
    if rising_edge(clk) then
      -- The pair after this one
      out_first <= '0';
      if ends = '1' then
        phase <= IDLE;
      elsif phase = BOTH and more_2 = '1' then
        rest_2 <= without_lowest(rest_2);
        spot_2 <= spot_2 + 1;
      elsif phase = BOTH and more_1 = '1' then
        rest_1 <= without_lowest(rest_1);
        spot_1 <= spot_1 + 1;
        rest_2 <= all_2;
        spot_2 <= base_2;
      elsif phase = BOTH then
        phase  <= FIRST_ALONE;
        rest_1 <= all_1;
        spot_1 <= base_1;
      elsif phase = FIRST_ALONE and more_1 = '1' then
        rest_1 <= without_lowest(rest_1);
        spot_1 <= spot_1 + 1;
      elsif phase = FIRST_ALONE then
        phase  <= SECOND_ALONE;
        rest_2 <= all_2;
        spot_2 <= base_2;
      else
        rest_2 <= without_lowest(rest_2);
        spot_2 <= spot_2 + 1;
      end if;

      -- The next laser
      if take = '1' then
        has := (or slots_2) & (or slots_1);
        if paper = '1' then
          all_1  <= only(slots_1, farthest_1);
          all_2  <= only(slots_2, farthest_2);
          rest_1 <= only(slots_1, farthest_1);
          rest_2 <= only(slots_2, farthest_2);
          base_1 <= ones_below(slots_1, farthest_1);
          base_2 <= ones_below(slots_2, farthest_2);
          spot_1 <= ones_below(slots_1, farthest_1);
          spot_2 <= ones_below(slots_2, farthest_2);
        else
          all_1  <= slots_1;
          all_2  <= slots_2;
          rest_1 <= slots_1;
          rest_2 <= slots_2;
          base_1 <= (others => '0');
          base_2 <= (others => '0');
          spot_1 <= (others => '0');
          spot_2 <= (others => '0');
        end if;
        if has = "11" then
          phase <= BOTH;
        elsif alone = '1' and has = "01" then
          phase <= FIRST_ALONE;
        elsif alone = '1' and has = "10" then
          phase <= SECOND_ALONE;
        else
          phase <= NOTHING;
        end if;
        out_has    <= has;
        out_first  <= '1';
        out_bank   <= bank;
        out_laser  <= next_laser;
        out_end    <= '1' when left = 1 else '0';
        next_laser <= next_laser + 1;
        left       <= left - 1;
        if left = 1 then
          walking <= '0';
        end if;
      end if;

      if start = '1' and ready = '1' then
        walking    <= '1';
        bank       <= start_bank;
        left       <= lasers;
        next_laser <= (others => '0');
      end if;

      if rst = '1' then
        walking <= '0';
        phase   <= IDLE;
      end if;
    end if;
  end process;

end architecture;
