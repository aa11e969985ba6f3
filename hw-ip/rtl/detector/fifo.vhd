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
    G_MARGIN     : natural := 0                     -- room is low when less than this many words fit
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

end architecture;
