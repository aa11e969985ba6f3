-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Square of an offset over its variance, one per clock.
--
-- Purpose     a term of chi squared
-- Method      the offset takes half of the shift that normalises the variance, which is that of its square
-- Latency     7
-- Throughput  one per clock. No reset: data only
-- Resources   a shifter of 31 bits, two multipliers, of 32 by 18 and 33 by 33 bits
-- Twin        karst_core's weighted.rs: Divisor::chi2

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity chi_square is
  port (
    clk     : in  std_ulogic;             -- rising edge
    enable  : in  std_ulogic;             -- registers move
    offset  : in  signed(26 downto 0);    -- mm, Q.16, at most 512 mm
    shift   : in  unsigned(4 downto 0);   -- the variance's, from reciprocal; one clock later
    inverse : in  unsigned(31 downto 0);  -- the variance's, from reciprocal, coarse; 2 clocks later
    chi2    : out unsigned(29 downto 0)   -- Q.12, at most 2 ** 30 - 1
  );
end entity;

architecture rtl of chi_square is

  signal size         : unsigned(25 downto 0);
  signal shifted      : signed(31 downto 0);
  signal is_odd       : signed(0 downto 0);
  signal is_odd_late  : signed(0 downto 0);
  signal is_large      : signed(0 downto 0);
  signal is_large_late : signed(0 downto 0);
  signal factor       : signed(17 downto 0);
  signal by_variance  : signed(49 downto 0);
  signal first        : signed(32 downto 0);
  signal shifted_late : signed(31 downto 0);
  signal product      : signed(64 downto 0);

begin

  factor <= signed('0' & inverse(31 downto 15));
  by_variance_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 18)
    port map (clk => clk, enable => enable, a => shifted, b => factor, product => by_variance);
  first <= resize(by_variance(49 downto 17), 33);
  shifted_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => 2)
    port map (clk => clk, enable => enable, value => shifted, later => shifted_late);
  product_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => first, b => shifted_late, product => product);
  odd_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => 4)
    port map (clk => clk, enable => enable, value => is_odd, later => is_odd_late);
  large_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => 4)
    port map (clk => clk, enable => enable, value => is_large, later => is_large_late);

  offset_p : process (clk)
    variable negative : signed(26 downto 0);
    variable wide     : unsigned(40 downto 0);
    variable term     : unsigned(31 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      negative := -offset;
      size     <= unsigned(negative(25 downto 0)) when offset(26) = '1' else unsigned(offset(25 downto 0));

      wide        := shift_left(resize(size, 41), to_integer(shift(4 downto 1)));
      shifted     <= signed('0' & wide(30 downto 0));
      is_large(0) <= or wide(40 downto 31);
      is_odd(0)   <= shift(0);

      term := unsigned(product(62 downto 31));
      if is_odd_late(0) = '1' then
        term := shift_left(term, 1);
      end if;
      chi2 <= term(29 downto 0);
      if is_large_late(0) = '1' or term(31 downto 30) /= 0 then
        chi2 <= (others => '1');
      end if;
    end if;
  end process;

end architecture;
