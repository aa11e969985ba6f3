-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Rounded quotient as magnitude and sign, several bits per clock without long paths.
--
-- Purpose     numerator / divisor rounded to the nearest integer, halves away from zero, or towards zero. Beyond the
--             quotient's width it is 2 ** G_QUOTIENT_WIDTH - 1. A zero divisor counts as one
-- Method      non-restoring, to round after half of the divisor has been added. A stage makes the remainders of all ways that its
--             bits can go at once, one adder each, and picks by their signs: the adders are not behind each other.
--             divide has one adder per bit behind each other instead
-- Latency     1 + ceil(G_QUOTIENT_WIDTH / G_BITS_PER_STAGE)
-- Throughput  one per clock. No reset: data only
-- Resources   2 ** G_BITS_PER_STAGE - 1 adders of the divisor's width per stage
-- Twin        karst_math::div_round, or the operator /, clamped to the quotient's width

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity quotient is
  generic (
    G_NUMERATOR_WIDTH : positive range 3 to 80 := 64;  -- bits of the numerator, sign included; more than the quotient's
    G_DIVISOR_WIDTH   : positive range 2 to 64 := 50;  -- bits of the divisor
    G_QUOTIENT_WIDTH  : positive range 2 to 64 := 30;  -- bits of the quotient's magnitude
    G_ROUND           : boolean                := true; -- to the nearest integer instead of towards zero
    G_BITS_PER_STAGE  : positive range 1 to 4  := 3    -- more: fewer clocks, but longer ones, and more adders
  );
  port (
    clk       : in  std_ulogic;                                -- rising edge
    enable    : in  std_ulogic := '1';                         -- registers move
    numerator : in  signed(G_NUMERATOR_WIDTH - 1 downto 0);    -- numerator
    divisor   : in  unsigned(G_DIVISOR_WIDTH - 1 downto 0);    -- divisor
    negative  : out std_ulogic;                                -- the numerator's sign
    magnitude : out unsigned(G_QUOTIENT_WIDTH - 1 downto 0)    -- the quotient without it
  );
end entity;

architecture rtl of quotient is

  constant B      : positive := G_BITS_PER_STAGE;
  constant STAGES : positive := (G_QUOTIENT_WIDTH + B - 1) / B;
  constant WIDTH  : positive := G_DIVISOR_WIDTH + 1;
  -- Half of the divisor may make the numerator longer than itself
  constant WHOLE  : positive := maximum(G_NUMERATOR_WIDTH, G_DIVISOR_WIDTH) + 1;
  constant HIGH   : positive := maximum(WHOLE - G_QUOTIENT_WIDTH, WIDTH);
  -- Odd multiples of the divisor: 1, 3, ... 2 ** B - 1
  constant WAYS_MOST : positive := 2 ** (B - 1);

  subtype remainder_t is unsigned(WIDTH - 1 downto 0);  -- two's complement
  subtype bits_t      is unsigned(G_QUOTIENT_WIDTH - 1 downto 0);
  type multiples_t is array (0 to WAYS_MOST - 1) of remainder_t;

  type remainder_array_t is array (natural range <>) of remainder_t;
  type multiples_array_t is array (natural range <>) of multiples_t;
  type bits_array_t      is array (natural range <>) of bits_t;

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

  -- Index 0 is after the first clock, index i after the stage i
  signal remainder  : remainder_array_t(0 to STAGES);
  signal multiples  : multiples_array_t(0 to STAGES);
  signal rest       : bits_array_t(0 to STAGES);  -- bits of the numerator to come, at the high end, and bits of the quotient
  signal sign       : std_ulogic_vector(0 to STAGES);
  signal products   : multiples_t;  -- but for a zero divisor
  signal is_zero    : std_ulogic;
  signal too_large  : std_ulogic_vector(0 to STAGES);
  signal high_part  : unsigned(HIGH - 1 downto 0);

begin

  round_p : process (clk)
    variable n    : unsigned(WHOLE - 1 downto 0);
    variable half : unsigned(G_DIVISOR_WIDTH - 2 downto 0);
    variable sum : unsigned(WHOLE downto 0);  -- the lowest bit only makes the carry
  begin
    if rising_edge(clk) and enable = '1' then
      -- The magnitude and half of the divisor in one addition
      n := unsigned(resize(numerator, WHOLE));
      if numerator(G_NUMERATOR_WIDTH - 1) = '1' then
        n := not n;
      end if;
      half := divisor(G_DIVISOR_WIDTH - 1 downto 1) when G_ROUND else (others => '0');
      sum  := (n & numerator(G_NUMERATOR_WIDTH - 1)) + (half & numerator(G_NUMERATOR_WIDTH - 1));
      high_part <= resize(sum(WHOLE downto G_QUOTIENT_WIDTH + 1), HIGH);
      rest(0)   <= sum(G_QUOTIENT_WIDTH downto 1);
      sign(0)   <= numerator(G_NUMERATOR_WIDTH - 1);
      for i in 0 to WAYS_MOST - 1 loop
        products(i) <= times(resize(divisor, WIDTH), 2 * i + 1);
      end loop;
      is_zero <= nor divisor;
    end if;
  end process;

  multiples_g : for i in 0 to WAYS_MOST - 1 generate
    multiples(0)(i) <= products(i) when is_zero = '0' else to_unsigned(2 * i + 1, WIDTH);
  end generate;

  remainder(0) <= high_part(WIDTH - 1 downto 0);
  too_large(0) <= '1' when high_part >= multiples(0)(0)(G_DIVISOR_WIDTH - 1 downto 0) else '0';

  stages_g : for stage in 1 to STAGES generate
    -- The last stage may have fewer bits
    constant BITS : positive := minimum(B, G_QUOTIENT_WIDTH - (stage - 1) * B);
    -- A tree: after one bit there is one way, from way i on there are 2 i and 2 i + 1
    subtype ways_t is remainder_array_t(1 to 2 ** BITS - 1);
    type new_bits_t is array (ways_t'range) of unsigned(BITS - 1 downto 0);
    signal picked   : ways_t;      -- where each way ends
    signal new_bits : new_bits_t;  -- and what bits it brings
    signal was_less : std_ulogic;
  begin

    was_less <= remainder(stage - 1)(WIDTH - 1);

    levels_g : for level in 1 to BITS generate
      ways_g : for way in 2 ** (level - 1) to 2 ** level - 1 generate
        constant MULTIPLE : natural := way - 2 ** (level - 1);
        signal shifted             : remainder_t;
        signal multiple_or_inverse : remainder_t;
        signal sum                 : unsigned(WIDTH downto 0);  -- the lowest bit only makes the borrow
        signal bit_here            : unsigned(BITS - 1 downto 0);
      begin
        shifted             <= remainder(stage - 1)(WIDTH - 1 - level downto 0)
                               & rest(stage - 1)(G_QUOTIENT_WIDTH - 1 downto G_QUOTIENT_WIDTH - level);
        -- Always a subtraction: r + d = r - not d - 1. yosys then needs one LUT per bit, for an addition two
        multiple_or_inverse <= not multiples(stage - 1)(MULTIPLE) when was_less = '1' else
                               multiples(stage - 1)(MULTIPLE);
        sum                 <= (shifted & '0') - (multiple_or_inverse & was_less);
        bit_here            <= to_unsigned(2 ** (BITS - level), BITS) when sum(WIDTH) = '0' else (others => '0');

        last_g : if level = BITS generate
          picked(way)   <= sum(WIDTH downto 1);
          new_bits(way) <= bit_here;
        end generate;

        -- The multiple that is subtracted, or added, becomes larger after a remainder of the sign of the first
        others_g : if level < BITS generate
          picked(way)   <= picked(2 * way + 1) when sum(WIDTH) = was_less else picked(2 * way);
          new_bits(way) <= bit_here or new_bits(2 * way + 1) when sum(WIDTH) = was_less else bit_here or new_bits(2 * way);
        end generate;
      end generate;
    end generate;

    stage_p : process (clk)
    begin
      if rising_edge(clk) and enable = '1' then
        remainder(stage) <= picked(1);
        rest(stage)      <= rest(stage - 1)(G_QUOTIENT_WIDTH - 1 - BITS downto 0) & new_bits(1);
        multiples(stage) <= multiples(stage - 1);
        sign(stage)      <= sign(stage - 1);
        too_large(stage) <= too_large(stage - 1);
      end if;
    end process;

  end generate;

  negative  <= sign(STAGES);
  magnitude <= (others => '1') when too_large(STAGES) = '1' else rest(STAGES);

end architecture;
