-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Synchronous first-in first-out buffer.
--
-- Purpose     holds words of the detector until the next block takes them
-- Latency     3 from a word that enters an empty buffer to out_valid
-- Throughput  one in and one out per clock
-- Resources   hw-ip/synth/resources.txt
-- Twin        none: it changes no data

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity fifo is
  generic (
    G_WIDTH      : positive := 36;                  -- bits of a word
    G_LOG2_DEPTH : positive range 1 to 16 := 9;     -- 2 ** this many words
    G_MARGIN     : natural := 0;                    -- room is low when less than this many words fit
    G_FORMAL     : boolean := false                 -- properties for the proof
  );
  port (
    clk       : in  std_ulogic;                               -- rising edge
    rst       : in  std_ulogic;                               -- synchronous, high: empty
    in_valid  : in  std_ulogic;                               -- word is there
    in_ready  : out std_ulogic;                               -- word is taken if it is there
    in_data   : in  std_ulogic_vector(G_WIDTH - 1 downto 0);  -- the word
    room      : out std_ulogic;                               -- at least G_MARGIN words fit: for pipelines that can not stop
    out_valid : out std_ulogic;                               -- word is there, until it is taken
    out_ready : in  std_ulogic;                               -- word is taken if it is there
    out_data  : out std_ulogic_vector(G_WIDTH - 1 downto 0)   -- the oldest word
  );
end entity;

architecture rtl of fifo is

  constant DEPTH : positive := 2 ** G_LOG2_DEPTH;

  type memory_t is array (0 to DEPTH - 1) of std_ulogic_vector(G_WIDTH - 1 downto 0);
  signal memory : memory_t;

  -- No word is read while it is written: proven below
  attribute no_rw_check : boolean;
  attribute no_rw_check of memory : signal is true;

  signal write_at : unsigned(G_LOG2_DEPTH - 1 downto 0);
  signal read_at  : unsigned(G_LOG2_DEPTH - 1 downto 0);
  signal count    : unsigned(G_LOG2_DEPTH downto 0);  -- words in the memory: not those fetched and at the output
  signal is_empty : std_ulogic;
  signal write    : std_ulogic;
  signal read     : std_ulogic;

  -- Behind the memory's own register there is a second one: a word comes out of block memories late in the clock
  signal fetched       : std_ulogic_vector(G_WIDTH - 1 downto 0);
  signal fetched_valid : std_ulogic;
  signal valid         : std_ulogic;
  signal move          : std_ulogic;

begin

  in_ready  <= not count(G_LOG2_DEPTH);
  write     <= in_valid and not count(G_LOG2_DEPTH);
  move      <= out_ready or not valid;
  read      <= not is_empty and (move or not fetched_valid);
  out_valid <= valid;

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      if write = '1' then
        memory(to_integer(write_at)) <= in_data;
      end if;
      if read = '1' then
        fetched <= memory(to_integer(read_at));
      end if;
      if move = '1' then
        out_data <= fetched;
      end if;
    end if;
  end process;

  count_p : process (clk)
  begin
    if rising_edge(clk) then
      if write = '1' then
        write_at <= write_at + 1;
      end if;
      if read = '1' then
        read_at       <= read_at + 1;
        fetched_valid <= '1';
      elsif move = '1' then
        fetched_valid <= '0';
      end if;
      if move = '1' then
        valid <= fetched_valid;
      end if;
      if write = '1' and read = '0' then
        count    <= count + 1;
        is_empty <= '0';
      elsif write = '0' and read = '1' then
        count <= count - 1;
        if count = 1 then
          is_empty <= '1';
        end if;
      end if;
      -- One clock late: a margin has to allow for it
      room <= '1' when count + G_MARGIN <= DEPTH else '0';
      if rst = '1' then
        write_at      <= (others => '0');
        read_at       <= (others => '0');
        count         <= (others => '0');
        is_empty      <= '1';
        fetched_valid <= '0';
        valid         <= '0';
      end if;
    end if;
  end process;

  -- Every word that goes in comes out once, in order and unchanged, and stays at the output until it is taken
  formal_g : if G_FORMAL generate
    -- Words in and out so far, and the number of one to watch: in reset the input tells which
    signal started  : std_ulogic := '0';
    signal written  : unsigned(G_LOG2_DEPTH + 1 downto 0);
    signal taken    : unsigned(G_LOG2_DEPTH + 1 downto 0);
    signal watched  : unsigned(G_LOG2_DEPTH + 1 downto 0);
    signal inside   : std_ulogic;                               -- the watched word is in the buffer
    signal word     : std_ulogic_vector(G_WIDTH - 1 downto 0);  -- its value
    signal ahead    : unsigned(G_LOG2_DEPTH + 1 downto 0);      -- words before it
    signal place    : unsigned(G_LOG2_DEPTH - 1 downto 0);      -- where it is in the memory
    signal held     : unsigned(G_LOG2_DEPTH + 1 downto 0);      -- words fetched and at the output
    signal was_held : std_ulogic;
    signal was_data : std_ulogic_vector(G_WIDTH - 1 downto 0);
  begin

    ahead <= watched - taken;
    held  <= to_unsigned(2, held'length) when (valid and fetched_valid) = '1' else
             to_unsigned(1, held'length) when (valid or fetched_valid) = '1' else to_unsigned(0, held'length);
    place <= read_at + ahead(G_LOG2_DEPTH - 1 downto 0) - held(G_LOG2_DEPTH - 1 downto 0);

    score_p : process (clk)
    begin
      if rising_edge(clk) then
        started  <= '1';
        was_held <= valid and not out_ready;
        was_data <= out_data;
        if write = '1' then
          written <= written + 1;
          if written = watched then
            inside <= '1';
            word   <= in_data;
          end if;
        end if;
        if valid = '1' and out_ready = '1' then
          taken <= taken + 1;
          if taken = watched then
            inside <= '0';
          end if;
        end if;
        if rst = '1' then
          written  <= (others => '0');
          taken    <= (others => '0');
          watched  <= resize(unsigned(in_data), watched'length);
          inside   <= '0';
          was_held <= '0';
        end if;
      end if;
    end process;

    default clock is rising_edge(clk);
    begins_with_reset : assume always (started = '1' or rst = '1');
    none_lost_or_doubled : assert always (started = '0' or written - taken = count + held);
    pointers_agree : assert always (started = '0' or (count <= DEPTH and write_at - read_at = count(G_LOG2_DEPTH - 1 downto 0)));
    is_inside : assert always (started = '0' or ((inside = '1') = (ahead < count + held)));
    empty_is_told : assert always (started = '0' or (is_empty = '1') = (count = 0));
    no_collision : assert always (started = '0' or write = '0' or read = '0' or write_at /= read_at);
    unchanged_in_memory : assert always (started = '0' or inside = '0' or ahead < held or memory(to_integer(place)) = word);
    unchanged_when_fetched : assert always (started = '0' or inside = '0' or fetched_valid = '0' or ahead + 1 /= held or fetched = word);
    unchanged_at_output : assert always (started = '0' or inside = '0' or ahead /= 0 or valid = '0' or out_data = word);
    kept_until_taken : assert always (started = '0' or was_held = '0' or (valid = '1' and out_data = was_data));

  end generate;

end architecture;
