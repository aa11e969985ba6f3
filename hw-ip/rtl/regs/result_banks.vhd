-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Three banks of results: one is read, one waits, one is written.
--
-- Purpose     the frame that is being read stays as it is until it is acknowledged; meanwhile newer frames replace each
--             other, and the newest complete one comes next. A frame that is being written disturbs neither
-- Latency     1 from done to ready if nothing is read; 2 from acknowledge to ready if a frame waits
-- Throughput  a frame at a time
-- Resources   about 15 LUT and 10 FF
-- Twin        karst_regs::model::Registers: write_result, write_spot, finish_frame

library ieee;
use ieee.std_logic_1164.all;

entity result_banks is
  port (
    clk          : in  std_ulogic;                     -- rising edge
    rst          : in  std_ulogic;                     -- synchronous, high: no results
    done         : in  std_ulogic;                     -- one clock: all records of a frame are in the bank write_bank
    acknowledge  : in  std_ulogic;                     -- one clock: the results have been read
    ready        : out std_ulogic;                     -- the bank read_bank holds a frame
    read_bank    : out std_ulogic_vector(1 downto 0);  -- the bank to read, 0 to 2
    write_bank   : out std_ulogic_vector(1 downto 0);  -- the bank to write, another one
    event_ready  : out std_ulogic;                     -- one clock: a frame became ready
    event_missed : out std_ulogic                      -- one clock: a frame was lost that had not become ready
  );
end entity;

architecture rtl of result_banks is

  subtype bank_t is std_ulogic_vector(1 downto 0);
  signal reading   : bank_t;
  signal waiting   : bank_t;
  signal writing   : bank_t;
  signal is_read   : std_ulogic;  -- the bank to read holds a frame
  signal one_waits : std_ulogic;  -- the bank that waits holds one

begin

  ready      <= is_read;
  read_bank  <= reading;
  write_bank <= writing;

  banks_p : process (clk)
  begin
    if rising_edge(clk) then
      event_ready  <= '0';
      event_missed <= '0';
      if acknowledge = '1' then
        is_read <= '0';
      end if;
      if is_read = '0' and (one_waits = '1' or done = '1') then
        is_read     <= '1';
        event_ready <= '1';
        if one_waits = '1' then
          reading <= waiting;
          waiting <= reading;
          if done = '1' then
            waiting <= writing;
            writing <= reading;
          end if;
          one_waits <= done;
        else
          reading <= writing;
          writing <= reading;
        end if;
      elsif done = '1' then
        waiting      <= writing;
        writing      <= waiting;
        one_waits    <= '1';
        event_missed <= one_waits;
      end if;
      if rst = '1' then
        reading      <= "00";
        waiting      <= "01";
        writing      <= "10";
        is_read      <= '0';
        one_waits    <= '0';
        event_ready  <= '0';
        event_missed <= '0';
      end if;
    end if;
  end process;

end architecture;
