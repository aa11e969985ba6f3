-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Signed product, one per clock.
--
-- Purpose     a multiplier with the registers that DSP blocks want
-- Latency     2
-- Throughput  one per clock, no stall. No reset: data only
-- Resources   DSP48E1 of 25 x 18 bits each as the widths need them
-- Twin        the operator * on i64

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity multiply is
  generic (
    G_A_WIDTH : positive range 2 to 64;  -- bits of the first factor
    G_B_WIDTH : positive range 2 to 64   -- bits of the second factor
  );
  port (
    clk     : in  std_ulogic;                              -- rising edge
    a       : in  signed(G_A_WIDTH - 1 downto 0);          -- first factor
    b       : in  signed(G_B_WIDTH - 1 downto 0);          -- second factor
    product : out signed(G_A_WIDTH + G_B_WIDTH - 1 downto 0)  -- their product
  );
end entity;

architecture rtl of multiply is

  signal first : signed(G_A_WIDTH + G_B_WIDTH - 1 downto 0);

begin

  multiply_p : process (clk)
  begin
    if rising_edge(clk) then
      first   <= a * b;
      product <= first;
    end if;
  end process;

end architecture;
