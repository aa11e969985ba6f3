-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Two banks of results: one is read while the other one is written.
--
-- Purpose     the frame that is being read stays as it is until it is acknowledged; meanwhile newer frames replace each
--             other in the other bank, and the newest complete one comes next
-- Rules       A frame is written, then done comes, at a later clock than its last write. An acknowledgement less than two
--             clocks before the next frame's first write comes too late for the frame that waits: it is missed.
-- Latency     1 from done to ready if nothing is read; 2 from acknowledge to ready if a frame waits
-- Throughput  a frame at a time
-- Resources   about 10 LUT and 5 FF
-- Twin        karst_regs::model::Registers: write_result, write_spot, finish_frame

library ieee;
use ieee.std_logic_1164.all;

entity result_banks is
  port (
    clk          : in  std_ulogic;  -- rising edge
    rst          : in  std_ulogic;  -- synchronous, high: no results
    write        : in  std_ulogic;  -- a record is written to the bank write_bank
    done         : in  std_ulogic;  -- one clock: all records of the frame have been written
    acknowledge  : in  std_ulogic;  -- one clock: the results have been read
    ready        : out std_ulogic;  -- the bank read_bank holds a frame
    read_bank    : out std_ulogic;  -- the bank to read
    write_bank   : out std_ulogic;  -- the other one
    event_ready  : out std_ulogic;  -- one clock: a frame became ready
    event_missed : out std_ulogic   -- one clock: a frame was lost that had not become ready
  );
end entity;

architecture rtl of result_banks is

  signal bank    : std_ulogic;  -- to read
  signal is_read : std_ulogic;  -- it holds a frame
  signal waiting : std_ulogic;  -- the other one holds a complete frame

begin

  ready      <= is_read;
  read_bank  <= bank;
  write_bank <= not bank;

  banks_p : process (clk)
  begin
    if rising_edge(clk) then
      event_ready  <= '0';
      event_missed <= '0';
      if acknowledge = '1' then
        is_read <= '0';
      end if;
      if write = '1' and waiting = '1' then
        waiting      <= '0';
        event_missed <= '1';
      elsif (done = '1' or waiting = '1') and is_read = '0' then
        waiting     <= '0';
        bank        <= not bank;
        is_read     <= '1';
        event_ready <= '1';
      elsif done = '1' then
        waiting <= '1';
      end if;
      if rst = '1' then
        bank    <= '0';
        is_read <= '0';
        waiting <= '0';
      end if;
    end if;
  end process;

end architecture;
