-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Reciprocal of the upper 16 bits of a normalised word, several bits per clock without long paths.
--
-- Purpose     (2 ** 32 - 1) / (1 + the word's upper 16 bits), rounded down
-- Method      non-restoring. A stage makes the remainders of all ways that its bits can go at once, one adder each, and picks
--             by their signs: the adders are not behind each other. divide has one adder per bit behind each other instead
-- Latency     1 + ceil(17 / G_BITS_PER_STAGE)
-- Throughput  one per clock, no stall. No reset: data only
-- Resources   2 ** G_BITS_PER_STAGE - 1 adders of 18 bits per stage
-- Twin        karst_math::reciprocal_coarse, which shifts it to the left by 15 bits

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity reciprocal_coarse is
  generic (
    G_BITS_PER_STAGE : positive range 1 to 4 := 3  -- more: fewer clocks, but longer ones, and more adders
  );
  port (
    clk        : in  std_ulogic;             -- rising edge
    enable     : in  std_ulogic := '1';      -- registers move
    normalised : in  unsigned(31 downto 0);  -- the word: its top bit is set
    inverse    : out unsigned(16 downto 0)   -- 2 ** 48 over it, at most 2 ** -14 of that too small
  );
end entity;

architecture rtl of reciprocal_coarse is

  constant B      : positive := G_BITS_PER_STAGE;
  constant STAGES : positive := (17 + B - 1) / B;
  -- Odd multiples of the divisor: 1, 3, ... 2 ** B - 1
  constant MULTIPLES_MOST : positive := 2 ** (B - 1);

  subtype remainder_t is unsigned(17 downto 0);  -- two's complement
  type multiples_t is array (0 to MULTIPLES_MOST - 1) of remainder_t;

  type remainder_array_t is array (natural range <>) of remainder_t;
  type multiples_array_t is array (natural range <>) of multiples_t;
  type quotient_array_t  is array (natural range <>) of unsigned(16 downto 0);

  -- Before the first stage: what is above the numerator's lower 17 bits, all of them ones
  constant FIRST_REMAINDER : remainder_t := to_unsigned(2 ** 15 - 1, 18);

  -- As remainders modulo their width. (Not a product: yosys would take a DSP block)
  function times(value : remainder_t; factor : positive) return remainder_t is
    variable sum : remainder_t := value;
  begin
    if factor = 2 ** B - 1 then
      return shift_left(value, B) - value;
    end if;
    for i in 1 to B - 1 loop
      if (factor / 2 ** i) mod 2 = 1 then
        sum := sum + shift_left(value, i);
      end if;
    end loop;
    return sum;
  end function;

  -- Index i is after the stage i
  signal remainder : remainder_array_t(0 to STAGES);
  signal multiples : multiples_array_t(0 to STAGES);
  signal quotient  : quotient_array_t(0 to STAGES);  -- its upper bits, as many as are known

begin

  remainder(0) <= FIRST_REMAINDER;
  quotient(0)  <= (others => '0');

  divisor_p : process (clk)
    variable divisor : remainder_t;
  begin
    if rising_edge(clk) and enable = '1' then
      divisor := resize(normalised(31 downto 16), 18) + 1;
      for i in 0 to MULTIPLES_MOST - 1 loop
        multiples(0)(i) <= times(divisor, 2 * i + 1);
      end loop;
    end if;
  end process;

  stages_g : for stage in 1 to STAGES generate
    -- The last stage may have fewer bits
    constant BITS : positive := minimum(B, 17 - (stage - 1) * B);
    -- A tree: after one bit there is one way, from way i on there are 2 i and 2 i + 1
    subtype ways_t is remainder_array_t(1 to 2 ** BITS - 1);
    type new_bits_t is array (ways_t'range) of unsigned(BITS - 1 downto 0);
    signal picked   : ways_t;      -- where each way ends
    signal new_bits : new_bits_t;  -- and what bits it brings
    signal was_less : std_ulogic;
  begin

    was_less <= remainder(stage - 1)(17);

    levels_g : for level in 1 to BITS generate
      ways_g : for way in 2 ** (level - 1) to 2 ** level - 1 generate
        constant MULTIPLE : natural := way - 2 ** (level - 1);
        signal shifted             : remainder_t;
        signal multiple_or_inverse : remainder_t;
        signal sum                 : unsigned(18 downto 0);  -- the lowest bit only makes the borrow
        signal bit_here            : unsigned(BITS - 1 downto 0);
      begin
        shifted             <= remainder(stage - 1)(17 - level downto 0) & to_unsigned(2 ** level - 1, level);
        -- Always a subtraction: r + d = r - not d - 1. yosys then needs one LUT per bit, for an addition two
        multiple_or_inverse <= not multiples(stage - 1)(MULTIPLE) when was_less = '1' else
                               multiples(stage - 1)(MULTIPLE);
        sum                 <= (shifted & '0') - (multiple_or_inverse & was_less);
        bit_here            <= to_unsigned(2 ** (BITS - level), BITS) when sum(18) = '0' else (others => '0');

        last_g : if level = BITS generate
          picked(way)   <= sum(18 downto 1);
          new_bits(way) <= bit_here;
        end generate;

        -- The multiple that is subtracted, or added, becomes larger after a remainder of the sign of the first
        others_g : if level < BITS generate
          picked(way)   <= picked(2 * way + 1) when sum(18) = was_less else picked(2 * way);
          new_bits(way) <= bit_here or new_bits(2 * way + 1) when sum(18) = was_less else bit_here or new_bits(2 * way);
        end generate;
      end generate;
    end generate;

    stage_p : process (clk)
    begin
      if rising_edge(clk) and enable = '1' then
        remainder(stage) <= picked(1);
        quotient(stage)  <= quotient(stage - 1)(16 - BITS downto 0) & new_bits(1);
        multiples(stage) <= multiples(stage - 1);
      end if;
    end process;

  end generate;

  inverse <= quotient(STAGES);

end architecture;
