-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- One step of a Horner chain: saturate((factor * argument) rounded to the fraction of the factor + addend).
--
-- Purpose     32-bit fixed-point multiply-add; the argument is Q3.29; the product is rounded, halves up
-- Latency     4 (two for the multiplier, one for the addition, one for the saturation)
-- Throughput  one per clock, no stall. No reset: it has no state
-- Resources   one 32 x 32 multiplier (4 DSP48E1), about 110 LUT
-- Twin        karst_math::round_shift and karst_math::saturate_i32, as karst_math::horner uses them

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity multiply_add is
  port (
    clk      : in  std_ulogic;                      -- rising edge
    factor   : in  std_ulogic_vector(31 downto 0);  -- signed, any fraction
    argument : in  std_ulogic_vector(31 downto 0);  -- signed, Q3.29
    addend   : in  std_ulogic_vector(31 downto 0);  -- signed, the fraction of factor; two clocks after factor
    result   : out std_ulogic_vector(31 downto 0)   -- signed, the fraction of factor
  );
end entity;

architecture rtl of multiply_add is

  constant FRACTION : positive := 29;
  constant HALF     : signed(63 downto 0) := shift_left(to_signed(1, 64), FRACTION - 1);

  signal product      : signed(63 downto 0);
  signal product_held : signed(63 downto 0);
  signal sum          : signed(64 - FRACTION downto 0);

begin

  step_p : process (clk)
    variable rounded : signed(63 downto 0);
  begin
    if rising_edge(clk) then
      product      <= signed(factor) * signed(argument);
      product_held <= product;
      -- A product is at most 2 ** 62: the half does not overflow
      rounded := product_held + HALF;
      sum     <= resize(rounded(63 downto FRACTION), sum'length) + signed(addend);
      if sum(sum'high downto 31) = 0 or sum(sum'high downto 31) = -1 then
        result <= std_ulogic_vector(sum(31 downto 0));
      else
        result <= (31 => sum(sum'high), others => not sum(sum'high));
      end if;
    end if;
  end process;

end architecture;
