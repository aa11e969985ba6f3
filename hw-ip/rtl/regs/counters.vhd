-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- How often things happened: counters in one small memory.
--
-- Purpose     the counters of karst.rdl. One of them is looked after per clock, in turn or because the bus asks for it;
--             meanwhile the events of the others are summed
-- Rules       All but the frames stop at their highest value; a write sets to zero. A read counts every event before the
--             clock of its request
-- Latency     2 or 3 from request to answered
-- Throughput  an access at a time; every event at every clock
-- Resources   16 words of memory, about 200 LUT
-- Twin        karst_regs::model::Registers: the counters

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity counters is
  port (
    clk              : in  std_ulogic;                      -- rising edge
    rst              : in  std_ulogic;                      -- synchronous, high: everything is zero
    request          : in  std_ulogic;                      -- an access; it stays, as what follows, until it is answered
    is_write         : in  std_ulogic;                      -- it sets the counter to zero
    index            : in  std_ulogic_vector(3 downto 0);   -- of the counter: word from the first one on
    answered         : out std_ulogic;                      -- one clock: the access is done
    found            : out std_ulogic_vector(31 downto 0);  -- with it: the counter; zero otherwise
    -- Events, one clock each; index 0 is camera 1
    event_ready      : in  std_ulogic;                      -- a frame became ready
    event_missed     : in  std_ulogic;                      -- a frame's results were lost
    event_unpaired   : in  std_ulogic;                      -- a frame had no partner
    event_skipped    : in  std_ulogic;                      -- a frame was not taken because of a commit
    event_short_row  : in  std_ulogic_vector(1 downto 0);   -- a row ended before the width
    event_long_row   : in  std_ulogic_vector(1 downto 0);   -- a row ended after the width
    event_truncated  : in  std_ulogic_vector(1 downto 0);   -- a frame ended before its height
    event_stray_row  : in  std_ulogic_vector(1 downto 0);   -- a row came outside a frame
    event_stalled    : in  std_ulogic_vector(1 downto 0)    -- a beat had to wait
  );
end entity;

architecture rtl of counters is

  constant COUNT : positive := 16;

  -- Indices, as in karst.rdl
  subtype index_t is natural range 0 to COUNT - 1;
  type indices_t is array (natural range <>) of index_t;
  constant FRAMES     : index_t := 0;
  constant MISSED     : index_t := 1;
  constant UNPAIRED   : index_t := 2;
  constant SKIPPED    : index_t := 3;
  constant SHORT_ROWS : indices_t(0 to 1) := (4, 9);
  constant LONG_ROWS  : indices_t(0 to 1) := (5, 10);
  constant TRUNCATED  : indices_t(0 to 1) := (6, 11);
  constant STRAY_ROWS : indices_t(0 to 1) := (7, 12);
  constant STALLED    : indices_t(0 to 1) := (8, 13);
  subtype used_t is index_t range 0 to 13;

  -- Events of a counter until it is its turn: two clocks per counter at most
  subtype sum_t is unsigned(5 downto 0);
  type sums_t is array (used_t) of sum_t;

  subtype word_t is std_ulogic_vector(31 downto 0);
  type memory_t is array (0 to COUNT - 1) of word_t;
  signal memory : memory_t := (others => (others => '0'));

  signal events   : std_ulogic_vector(used_t);
  signal sums     : sums_t;
  signal clearing : std_ulogic;  -- after a reset: all are set to zero in turn
  signal turn     : unsigned(3 downto 0);

  -- The one that is looked after
  signal for_bus  : std_ulogic;
  signal chosen   : unsigned(3 downto 0);
  signal collides : std_ulogic;  -- the same one is still being written

  -- One clock later
  signal writing     : std_ulogic;
  signal answering   : std_ulogic;
  signal place       : unsigned(3 downto 0);
  signal value       : word_t;
  signal to_zero     : std_ulogic;
  signal more        : sum_t;
  signal answer_read : std_ulogic;
  signal result      : word_t;

begin

  for_bus  <= request and not answering and not answered;
  chosen   <= unsigned(index) when for_bus = '1' else turn;
  collides <= '1' when writing = '1' and chosen = place else '0';

  events(FRAMES)   <= event_ready;
  events(MISSED)   <= event_missed;
  events(UNPAIRED) <= event_unpaired;
  events(SKIPPED)  <= event_skipped;

  cameras_g : for camera in 0 to 1 generate
    events(SHORT_ROWS(camera)) <= event_short_row(camera);
    events(LONG_ROWS(camera))  <= event_long_row(camera);
    events(TRUNCATED(camera))  <= event_truncated(camera);
    events(STRAY_ROWS(camera)) <= event_stray_row(camera);
    events(STALLED(camera))    <= event_stalled(camera);
  end generate;

  choose_p : process (clk)
  begin
    if rising_edge(clk) then
      if for_bus = '0' and collides = '0' then
        turn <= turn + 1;
        if turn = COUNT - 1 then
          clearing <= '0';
        end if;
      end if;

      more <= (others => '0');
      for i in sums'range loop
        if chosen = i then
          more <= sums(i);
        end if;
        if chosen = i and collides = '0' then
          sums(i) <= (0 => events(i), others => '0');
        elsif events(i) = '1' then
          sums(i) <= sums(i) + 1;
        end if;
      end loop;

      writing     <= not collides;
      answering   <= for_bus and not collides;
      answer_read <= for_bus and not is_write;
      to_zero     <= clearing or (for_bus and is_write);
      place       <= chosen;

      if rst = '1' then
        sums      <= (others => (others => '0'));
        clearing  <= '1';
        turn      <= (others => '0');
        writing   <= '0';
        answering <= '0';
      end if;
    end if;
  end process;

  add_p : process (all)
    variable sum : unsigned(31 downto 0);
  begin
    sum := unsigned(value) + more;
    if place /= FRAMES and sum(16) = '1' then
      sum := x"0000FFFF";
    end if;
    if to_zero = '1' then
      sum := (others => '0');
    end if;
    result <= std_ulogic_vector(sum);
  end process;

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      value <= memory(to_integer(chosen));
      if writing = '1' then
        memory(to_integer(place)) <= result;
      end if;
      answered <= answering;
      found    <= result;
      if answering = '0' or answer_read = '0' then
        found <= (others => '0');
      end if;
      if rst = '1' then
        answered <= '0';
      end if;
    end if;
  end process;

end architecture;
