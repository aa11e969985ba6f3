-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- One step of a Horner chain: saturate((factor * argument) rounded down to the fraction of the factor + addend).
--
-- Purpose     32-bit fixed-point multiply-add; the argument is Q3.29; the product is rounded down
-- Latency     3 (two for the multiplier, one for the saturation)
-- Throughput  one per clock, no stall. No reset: it has no state
-- Resources   one 32 x 32 multiplier (4 DSP48E1), about 110 LUT
-- Twin        karst_math::saturate_i32 of a product, as karst_math::horner uses it

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.rounding.all;

entity multiply_add is
  port (
    clk      : in  std_ulogic;                      -- rising edge
    enable   : in  std_ulogic := '1';               -- registers move
    factor   : in  std_ulogic_vector(31 downto 0);  -- signed, any fraction
    argument : in  std_ulogic_vector(31 downto 0);  -- signed, Q3.29
    addend   : in  std_ulogic_vector(31 downto 0);  -- signed, the fraction of factor; one clock after factor
    result   : out std_ulogic_vector(31 downto 0)   -- signed, the fraction of factor
  );
end entity;

architecture rtl of multiply_add is

  constant FRACTION : positive := 29;

  signal addend_wide : signed(63 downto 0);
  signal sum         : signed(63 downto 0);

begin

  -- A product is at most 2 ** 62: the addend does not make it overflow
  addend_wide <= shift_left(resize(signed(addend), 64), FRACTION);
  sum_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => signed(factor), b => signed(argument), addend => addend_wide,
              product => sum);

  saturate_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      result <= std_ulogic_vector(saturate(sum(63 downto FRACTION), 32));
    end if;
  end process;

end architecture;
