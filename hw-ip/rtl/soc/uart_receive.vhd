-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Receiver of a serial line: 8 data bits, no parity, 1 stop bit.
--
-- Purpose     bytes from a line
-- Rules       A bit is looked at in its middle. A byte without stop bit is not given but told as broken.
-- Latency     2 + 9.5 bits from the start of the start bit to valid
-- Throughput  one byte per 9.5 bits or more
-- Resources   about 40 LUT and FF
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity uart_receive is
  port (
    clk            : in  std_ulogic;                     -- rising edge
    rst            : in  std_ulogic;                     -- synchronous, high: waits for a start bit
    clocks_per_bit : in  unsigned(15 downto 0);          -- at least 4
    rx             : in  std_ulogic;                     -- the line, not synchronous
    valid          : out std_ulogic;                     -- one clock: a byte
    data           : out std_ulogic_vector(7 downto 0);  -- the byte
    broken         : out std_ulogic                      -- one clock: a byte without stop bit
  );
end entity;

architecture rtl of uart_receive is

  constant BITS : natural := 10;  -- start, data, stop

  signal line     : std_ulogic_vector(2 downto 0);  -- the line 1, 2 and 3 clocks ago
  signal left     : unsigned(3 downto 0);           -- bits that are still to come
  signal wait_for : unsigned(15 downto 0);          -- clocks to the middle of the next one
  signal shift    : std_ulogic_vector(7 downto 0);  -- the last bits

begin

  data <= shift;

  receive_p : process (clk)
  begin
    if rising_edge(clk) then
      line   <= line(1 downto 0) & rx;
      valid  <= '0';
      broken <= '0';
      if left = 0 then
        -- A line that stays low is no start bit
        if line(2 downto 1) = "10" then
          left     <= to_unsigned(BITS, 4);
          wait_for <= '0' & clocks_per_bit(15 downto 1);
        end if;
      elsif wait_for > 1 then
        wait_for <= wait_for - 1;
      else
        wait_for <= clocks_per_bit;
        left     <= left - 1;
        if left = BITS then
          if line(1) = '1' then
            left <= (others => '0');
          end if;
        elsif left = 1 then
          valid  <= line(1);
          broken <= not line(1);
        else
          shift <= line(1) & shift(7 downto 1);
        end if;
      end if;
      if rst = '1' then
        line   <= (others => '1');
        left   <= (others => '0');
        valid  <= '0';
        broken <= '0';
      end if;
    end if;
  end process;

end architecture;
