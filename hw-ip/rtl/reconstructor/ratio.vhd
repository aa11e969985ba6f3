-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Share of a part in a whole whose reciprocal is known, one per clock.
--
-- Purpose     part / whole, of two variances
-- Latency     3
-- Throughput  one per clock. No reset: data only
-- Resources   a shifter of 32 bits, one multiplier of 33 by 18 bits
-- Twin        karst_core's weighted.rs: Divisor::ratio

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity ratio is
  port (
    clk     : in  std_ulogic;             -- rising edge
    enable  : in  std_ulogic;             -- registers move
    part    : in  unsigned(31 downto 0);  -- not above the whole
    shift   : in  unsigned(4 downto 0);   -- the whole's, from reciprocal
    inverse : in  unsigned(31 downto 0);  -- the whole's, from reciprocal, coarse; one clock later
    share   : out unsigned(31 downto 0)   -- Q.31
  );
end entity;

architecture rtl of ratio is

  signal shifted : signed(32 downto 0);
  signal factor  : signed(17 downto 0);
  signal product : signed(50 downto 0);

begin

  shifted <= signed('0' & shift_left(part, to_integer(shift))) when rising_edge(clk) and enable = '1';
  factor  <= signed('0' & inverse(31 downto 15));
  product_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 18)
    port map (clk => clk, enable => enable, a => shifted, b => factor, product => product);
  share <= unsigned(product(48 downto 17));

end architecture;
