-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Has the settings take effect: all of them, at a frame boundary.
--
-- Purpose     after a commit it waits until no frame is under way, then streams the whole settings memory to the blocks
--             that hold settings of their own (detector_settings, the reconstructor). They change while nothing uses
--             them, and memory and blocks hold the same afterwards. Until then the memory is closed for writing and no
--             frame may start (committing).
-- Latency     G_WORDS + 3 clocks without a frame
-- Throughput  a word per clock
-- Resources   about 70 FF and 20 LUT
-- Twin        karst_regs::model::Registers::finish_commit

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity settings_load is
  generic (
    G_WORDS : positive range 1 to 65536 := 1024  -- words of the settings memory
  );
  port (
    clk             : in  std_ulogic;                      -- rising edge
    rst             : in  std_ulogic;                      -- synchronous, high: no settings
    commit          : in  std_ulogic;                      -- one clock: the memory is to take effect
    frame_idle      : in  std_ulogic;                      -- no frame is under way. Falls at the latest one clock after a
                                                           -- frame was let in, which needs committing = 0
    committing      : out std_ulogic;                      -- from the clock after commit until it is done
    commits         : out std_ulogic_vector(31 downto 0);  -- number of the settings in use, wraps around
    configured      : out std_ulogic;                      -- there are settings in use
    event_committed : out std_ulogic;                      -- one clock: a commit took effect
    memory_address  : out std_ulogic_vector(15 downto 0);  -- word of the settings memory
    memory_data     : in  std_ulogic_vector(31 downto 0);  -- the word, one clock later
    load_valid      : out std_ulogic;                      -- a word for the blocks
    load_address    : out std_ulogic_vector(15 downto 0);  -- its address in words
    load_data       : out std_ulogic_vector(31 downto 0)   -- the word
  );
end entity;

architecture rtl of settings_load is

  type state_t is (IDLE, WAITING, COPYING, LAST);
  signal state        : state_t;
  signal word         : unsigned(15 downto 0);
  signal copying_held : std_ulogic;             -- a clock ago
  signal count        : unsigned(31 downto 0);
  signal in_use       : std_ulogic;

begin

  committing     <= '0' when state = IDLE else '1';
  commits        <= std_ulogic_vector(count);
  configured     <= in_use;
  memory_address <= std_ulogic_vector(word);
  load_data      <= memory_data;
  load_valid     <= copying_held;

  load_p : process (clk)
  begin
    if rising_edge(clk) then
      event_committed <= '0';
      copying_held    <= '0';
      load_address    <= std_ulogic_vector(word);
      -- Not a case: GHDL 2.0 converts that to one without a default, which other tools make latches of
      if state = IDLE then
        word <= (others => '0');
        if commit = '1' then
          state <= WAITING;
        end if;
      elsif state = WAITING then
        if frame_idle = '1' then
          state <= COPYING;
        end if;
      elsif state = COPYING then
        copying_held <= '1';
        if word = G_WORDS - 1 then
          state <= LAST;
        else
          word <= word + 1;
        end if;
      else
        state           <= IDLE;
        count           <= count + 1;
        in_use          <= '1';
        event_committed <= '1';
      end if;
      if rst = '1' then
        state        <= IDLE;
        copying_held <= '0';
        count        <= (others => '0');
        in_use       <= '0';
      end if;
    end if;
  end process;

end architecture;
