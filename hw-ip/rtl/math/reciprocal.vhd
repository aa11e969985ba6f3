-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Reciprocal of a word, one per clock.
--
-- Purpose     a quotient as a product: of the normalised word, 17 bits or, with one step of Newton's method, 29
-- Latency     3 + ceil(17 / G_BITS_PER_STAGE); if G_EXACT, 8 + ceil(17 / G_BITS_PER_STAGE). The shift is there after 2 clocks
-- Throughput  one per clock, no stall. No reset: data only
-- Resources   a reciprocal_coarse; if G_EXACT, two multipliers, of 33 and 18 bits by 18
-- Twin        karst_math::reciprocal_coarse, karst_math::reciprocal

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity reciprocal is
  generic (
    G_EXACT          : boolean               := true;  -- with the step of Newton's method
    G_BITS_PER_STAGE : positive range 1 to 4 := 3      -- of the division
  );
  port (
    clk     : in  std_ulogic;             -- rising edge
    enable  : in  std_ulogic := '1';      -- registers move
    value   : in  unsigned(31 downto 0);  -- zero counts as one
    shift   : out unsigned(4 downto 0);   -- bits by which the value is shifted to the left until its top bit is set
    inverse : out unsigned(31 downto 0)   -- 2 ** 63 over the shifted value; if not G_EXACT, the lower 15 bits are zero
  );
end entity;

architecture rtl of reciprocal is

  constant COARSE_CLOCKS : positive := 1 + (17 + G_BITS_PER_STAGE - 1) / G_BITS_PER_STAGE;

  signal normalised : unsigned(31 downto 0);
  signal coarse     : unsigned(16 downto 0);

begin

  normalise_i : entity work.normalise
    port map (clk => clk, enable => enable, value => value, normalised => normalised, shift => shift);

  coarse_i : entity work.reciprocal_coarse
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, normalised => normalised, inverse => coarse);

  coarse_g : if not G_EXACT generate
    inverse <= coarse & to_unsigned(0, 15);
  end generate;

  exact_g : if G_EXACT generate
    signal normalised_line : signed(31 downto 0);
    signal normalised_late : signed(31 downto 0);
    signal factor          : signed(32 downto 0);
    signal coarse_factor   : signed(17 downto 0);
    signal coarse_product  : signed(17 downto 0);  -- with product
    signal coarse_late     : signed(17 downto 0);  -- with correction
    signal product         : signed(50 downto 0);
    signal missing         : signed(17 downto 0);
    signal correction      : signed(35 downto 0);
  begin

    normalised_line <= signed(normalised);
    normalised_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => COARSE_CLOCKS)
      port map (clk => clk, enable => enable, value => normalised_line, later => normalised_late);
    factor        <= '0' & normalised_late;
    coarse_factor <= signed('0' & coarse);
    product_i : entity work.multiply
      generic map (G_A_WIDTH => 33, G_B_WIDTH => 18)
      port map (clk => clk, enable => enable, a => factor, b => coarse_factor, product => product);
    coarse_product_i : entity work.delay
      generic map (G_WIDTH => 18, G_CLOCKS => 2)
      port map (clk => clk, enable => enable, value => coarse_factor, later => coarse_product);

    -- What the product lacks to 2 ** 48, in units of 2 ** 17 and less one: below 2 ** 17
    missing <= signed('0' & not product(33 downto 17));
    correction_i : entity work.multiply
      generic map (G_A_WIDTH => 18, G_B_WIDTH => 18)
      port map (clk => clk, enable => enable, a => missing, b => coarse_product, product => correction);
    coarse_late_i : entity work.delay
      generic map (G_WIDTH => 18, G_CLOCKS => 2)
      port map (clk => clk, enable => enable, value => coarse_product, later => coarse_late);

    inverse <= unsigned(coarse_late(16 downto 0) & to_signed(0, 15)) + unsigned(correction(33 downto 16))
               when rising_edge(clk) and enable = '1';

  end generate;

end architecture;
