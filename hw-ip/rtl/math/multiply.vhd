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

  subtype product_t is signed(2 * PART + 1 downto 0);
  type products_t   is array (0 to parts(G_A_WIDTH) - 1, 0 to parts(G_B_WIDTH) - 1) of product_t;

  -- The highest part has the sign
  function piece(value : signed; number, count : natural) return signed is
    alias v : signed(value'length - 1 downto 0) is value;
  begin
    if number = count - 1 then
      return v(v'high downto number * PART);
    end if;
    return '0' & v((number + 1) * PART - 1 downto number * PART);
  end function;

  function piece_bits(bits, number : natural) return positive is
  begin
    if number = parts(bits) - 1 then
      return bits - number * PART;
    end if;
    return PART + 1;
  end function;

  signal products : products_t;

begin

  rows_g : for i in 0 to parts(G_A_WIDTH) - 1 generate
    columns_g : for j in 0 to parts(G_B_WIDTH) - 1 generate
      -- A register for each, and without copies of its sign: else yosys can not move it into a DSP block, and loses bits
      signal kept : signed(piece_bits(G_A_WIDTH, i) + piece_bits(G_B_WIDTH, j) - 1 downto 0);
    begin
      product_p : process (clk)
      begin
        if rising_edge(clk) and enable = '1' then
          kept <= piece(a, i, parts(G_A_WIDTH)) * piece(b, j, parts(G_B_WIDTH));
        end if;
      end process;
      products(i, j) <= resize(kept, product_t'length);
    end generate;
  end generate;

  sum_p : process (clk)
    variable sum : signed(WIDTH - 1 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      sum := addend;
      for i in 0 to parts(G_A_WIDTH) - 1 loop
        for j in 0 to parts(G_B_WIDTH) - 1 loop
          sum := sum + shift_left(resize(products(i, j), WIDTH), PART * (i + j));
        end loop;
      end loop;
      product <= sum;
    end if;
  end process;

end architecture;
