-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Transmitter of a serial line: 8 data bits, no parity, 1 stop bit.
--
-- Purpose     bytes to a line
-- Latency     1 from a byte to the start of its start bit
-- Throughput  one byte per 10 bits and one clock
-- Resources   about 30 LUT and FF
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity uart_transmit is
  port (
    clk            : in  std_ulogic;                     -- rising edge
    rst            : in  std_ulogic;                     -- synchronous, high: the line is idle
    clocks_per_bit : in  unsigned(15 downto 0);          -- at least 4
    in_valid       : in  std_ulogic;                     -- a byte is there
    in_ready       : out std_ulogic;                     -- it is taken if it is there
    in_data        : in  std_ulogic_vector(7 downto 0);  -- the byte
    tx             : out std_ulogic                      -- the line
  );
end entity;

architecture rtl of uart_transmit is

  constant BITS : natural := 10;  -- start, data, stop

  signal left     : unsigned(3 downto 0);           -- bits that are not over yet
  signal wait_for : unsigned(15 downto 0);          -- clocks to the end of this one
  signal shift    : std_ulogic_vector(8 downto 0);  -- this bit, lowest, and the data bits that follow

begin

  in_ready <= '1' when left = 0 else '0';
  tx       <= shift(0);

  transmit_p : process (clk)
  begin
    if rising_edge(clk) then
      if left = 0 then
        if in_valid = '1' then
          shift    <= in_data & '0';
          left     <= to_unsigned(BITS, 4);
          wait_for <= clocks_per_bit;
        end if;
      elsif wait_for > 1 then
        wait_for <= wait_for - 1;
      else
        wait_for <= clocks_per_bit;
        left     <= left - 1;
        shift    <= '1' & shift(8 downto 1);
      end if;
      if rst = '1' then
        left  <= (others => '0');
        shift <= (others => '1');
      end if;
    end if;
  end process;

end architecture;
