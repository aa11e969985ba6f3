-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Variance of a length that moves with a spot, one per clock.
--
-- Purpose     square of the lever times the variance of the spot; levers and variances that are too large to count are cut off
-- Latency     5
-- Throughput  one per clock. No reset: data only
-- Resources   two multipliers, of 16 by 16 and 31 by 25 bits
-- Twin        karst_core's fusion.rs: variance

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity spread is
  port (
    clk      : in  std_ulogic;            -- rising edge
    enable   : in  std_ulogic;            -- registers move
    lever    : in  signed(26 downto 0);   -- mm per px, Q.10
    variance : in  signed(24 downto 0);   -- of the spot, px**2, Q.24, 0 to 1; 3 clocks after the lever
    result   : out unsigned(27 downto 0)  -- mm**2, Q.20
  );
end entity;

architecture rtl of spread is

  signal size    : signed(15 downto 0);
  signal square  : signed(31 downto 0);
  signal product : signed(56 downto 0);

begin

  square_i : entity work.multiply
    generic map (G_A_WIDTH => 16, G_B_WIDTH => 16)
    port map (clk => clk, enable => enable, a => size, b => size, product => square);
  product_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 25)
    port map (clk => clk, enable => enable, a => square, b => variance, product => product);

  result <= (others => '1') when product(55 downto 52) /= 0 else unsigned(product(51 downto 24));

  limit_p : process (clk)
    variable negative : signed(26 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      negative := -lever;
      if lever(26) = '0' then
        size <= resize(lever, 16);
        if lever(25 downto 15) /= 0 then
          size <= (15 => '0', others => '1');
        end if;
      else
        size <= resize(negative, 16);
        if negative(26 downto 15) /= 0 then
          size <= (15 => '0', others => '1');
        end if;
      end if;
    end if;
  end process;

end architecture;
