-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Signed product and sum, one per clock.
--
-- Purpose     a * b + addend: with half of the last bit that is wanted in the addend, the product is rounded for nothing
-- Method      products of up to 18 bits, which a DSP block makes, then their sum
-- Latency     2 from the factors, 1 from the addend
-- Throughput  one per clock, no stall. No reset: data only
-- Resources   a DSP block per 17 bits of one factor and 17 bits of the other, and adders
-- Twin        the operators * and + on i64

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity multiply is
  generic (
    G_A_WIDTH : positive range 2 to 64;  -- bits of the first factor
    G_B_WIDTH : positive range 2 to 64   -- bits of the second factor
  );
  port (
    clk     : in  std_ulogic;                                 -- rising edge
    enable  : in  std_ulogic := '1';                          -- registers move
    a       : in  signed(G_A_WIDTH - 1 downto 0);             -- first factor
    b       : in  signed(G_B_WIDTH - 1 downto 0);             -- second factor
    addend  : in  signed(G_A_WIDTH + G_B_WIDTH - 1 downto 0) := (others => '0');  -- one clock after the factors
    product : out signed(G_A_WIDTH + G_B_WIDTH - 1 downto 0)  -- a * b + addend, in that many bits
  );
end entity;

architecture rtl of multiply is

  constant WIDTH : positive := G_A_WIDTH + G_B_WIDTH;
  -- Bits of a part without the sign
  constant PART : positive := 17;

  -- The highest part may have 18 bits, sign included
  function parts(bits : positive) return positive is
  begin
    return (bits - 2) / PART + 1;
  end function;

  subtype factor_t  is signed(PART downto 0);
  subtype product_t is signed(2 * PART + 1 downto 0);
  type products_t   is array (0 to parts(G_A_WIDTH) - 1, 0 to parts(G_B_WIDTH) - 1) of product_t;

  function piece(value : signed; number, count : natural) return signed is
    alias v : signed(value'length - 1 downto 0) is value;
  begin
    if number = count - 1 then
      return resize(v(v'high downto number * PART), PART + 1);
    end if;
    return '0' & v((number + 1) * PART - 1 downto number * PART);
  end function;

  signal products : products_t;

begin

  multiply_p : process (clk)
    variable sum : signed(WIDTH - 1 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      sum := addend;
      for i in 0 to parts(G_A_WIDTH) - 1 loop
        for j in 0 to parts(G_B_WIDTH) - 1 loop
          products(i, j) <= piece(a, i, parts(G_A_WIDTH)) * piece(b, j, parts(G_B_WIDTH));
          sum            := sum + shift_left(resize(products(i, j), WIDTH), PART * (i + j));
        end loop;
      end loop;
      product <= sum;
    end if;
  end process;

end architecture;
