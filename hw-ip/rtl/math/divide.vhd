-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Signed division with rounding, one result per clock.
--
-- Purpose     quotient rounded to the nearest integer, halves away from zero. Beyond the quotient's width, and on a zero
--             denominator, it is the end -/+ (2 ** (G_QUOTIENT_WIDTH - 1) - 1) of the range that has its sign; 0 / 0
--             counts as positive
-- Method      non-restoring on the magnitudes, one adder per bit of the quotient, G_BITS_PER_STAGE bits between two
--             registers. The first bit tells an overflow, the last one is the half that decides the rounding
-- Latency     ceil((G_QUOTIENT_WIDTH + 1) / G_BITS_PER_STAGE) + 2
-- Throughput  one per clock, no stall
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_math::div_round, clamped to the quotient's width

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity divide is
  generic (
    G_NUMERATOR_WIDTH   : positive range 3 to 64 := 64;  -- bits of the numerator, sign included
    G_DENOMINATOR_WIDTH : positive range 2 to 64 := 64;  -- bits of the denominator, sign included
    G_QUOTIENT_WIDTH    : positive range 3 to 64 := 64;  -- bits of the quotient, sign included, at most the numerator's
    G_BITS_PER_STAGE    : positive range 1 to 8  := 1    -- more: fewer clocks, but longer ones
  );
  port (
    clk         : in  std_ulogic;                                           -- rising edge
    enable      : in  std_ulogic := '1';                                    -- registers move; if not, a reset does nothing either
    rst         : in  std_ulogic;                                           -- synchronous, high: forgets what is under way
    in_valid    : in  std_ulogic;                                           -- operands are there
    numerator   : in  std_ulogic_vector(G_NUMERATOR_WIDTH - 1 downto 0);    -- signed
    denominator : in  std_ulogic_vector(G_DENOMINATOR_WIDTH - 1 downto 0);  -- signed
    out_valid   : out std_ulogic;                                           -- quotient is there
    quotient    : out std_ulogic_vector(G_QUOTIENT_WIDTH - 1 downto 0)      -- signed
  );
end entity;

architecture rtl of divide is

  -- Overflow bit, magnitude, half
  constant STEPS : positive := G_QUOTIENT_WIDTH + 1;
  -- The part of the numerator that must be below the denominator, and the bits that follow
  constant HIGH_BITS : positive := G_NUMERATOR_WIDTH - G_QUOTIENT_WIDTH + 1;
  constant REST_BITS : positive := G_QUOTIENT_WIDTH - 1;

  -- The first remainder may be as wide as the high part
  constant WIDTH : positive := maximum(G_DENOMINATOR_WIDTH, HIGH_BITS + 1);

  subtype remainder_t is unsigned(WIDTH - 1 downto 0);  -- two's complement
  subtype divisor_t   is unsigned(G_DENOMINATOR_WIDTH - 1 downto 0);
  subtype rest_t      is unsigned(REST_BITS downto 0);
  subtype bits_t      is unsigned(STEPS - 1 downto 0);

  type remainder_array_t is array (natural range <>) of remainder_t;
  type divisor_array_t   is array (natural range <>) of divisor_t;
  type rest_array_t      is array (natural range <>) of rest_t;
  type bits_array_t      is array (natural range <>) of bits_t;

  -- Index 0 are the magnitudes, index i what step i makes of them
  signal remainder : remainder_array_t(0 to STEPS);
  signal divisor   : divisor_array_t(0 to STEPS);
  signal rest      : rest_array_t(0 to STEPS);  -- the bits of the numerator to come, at the high end; the half adds a zero
  signal bits      : bits_array_t(0 to STEPS);  -- the bits of the quotient so far, at the low end
  signal negative  : std_ulogic_vector(0 to STEPS);
  signal valid     : std_ulogic_vector(0 to STEPS);

begin

  magnitudes_p : process (clk)
    variable n : unsigned(G_NUMERATOR_WIDTH - 1 downto 0);
    variable d : divisor_t;
  begin
    if rising_edge(clk) and enable = '1' then
      n := unsigned(numerator);
      d := unsigned(denominator);
      if n(n'high) = '1' then
        n := not n + 1;
      end if;
      if d(d'high) = '1' then
        d := not d + 1;
      end if;
      remainder(0) <= resize(n(n'high downto REST_BITS), WIDTH);
      rest(0)      <= n(REST_BITS - 1 downto 0) & '0';
      divisor(0)   <= d;
      negative(0)  <= numerator(numerator'high) xor denominator(denominator'high);
      valid(0)     <= in_valid;
      if rst = '1' then
        valid(0) <= '0';
      end if;
    end if;
  end process;

  bits(0) <= (others => '0');

  steps_g : for i in 0 to STEPS - 1 generate
    signal shifted            : remainder_t;
    signal following          : rest_t;
    signal subtract           : std_ulogic;
    signal divisor_or_inverse : remainder_t;
    signal sum                : unsigned(WIDTH downto 0);  -- the lowest bit only makes the borrow
  begin

    first_g : if i = 0 generate
      shifted   <= remainder(0);
      following <= rest(0);
    end generate;

    others_g : if i > 0 generate
      shifted   <= remainder(i)(WIDTH - 2 downto 0) & rest(i)(REST_BITS);
      following <= shift_left(rest(i), 1);
    end generate;

    -- Always a subtraction: r + d = r - not d - 1. yosys then needs one LUT per bit, for an addition two
    subtract           <= '1' when i = 0 else not remainder(i)(WIDTH - 1);
    divisor_or_inverse <= resize(divisor(i), WIDTH) when subtract = '1' else not resize(divisor(i), WIDTH);
    sum                <= (shifted & '0') - (divisor_or_inverse & not subtract);

    wires_g : if (i + 1) mod G_BITS_PER_STAGE /= 0 and i + 1 /= STEPS generate
      remainder(i + 1) <= sum(WIDTH downto 1);
      bits(i + 1)      <= bits(i)(STEPS - 2 downto 0) & not sum(WIDTH);
      rest(i + 1)      <= following;
      divisor(i + 1)   <= divisor(i);
      negative(i + 1)  <= negative(i);
      valid(i + 1)     <= valid(i);
    end generate;

    registers_g : if (i + 1) mod G_BITS_PER_STAGE = 0 or i + 1 = STEPS generate
      step_p : process (clk)
      begin
        if rising_edge(clk) and enable = '1' then
          remainder(i + 1) <= sum(WIDTH downto 1);
          bits(i + 1)      <= bits(i)(STEPS - 2 downto 0) & not sum(WIDTH);
          rest(i + 1)      <= following;
          divisor(i + 1)   <= divisor(i);
          negative(i + 1)  <= negative(i);
          valid(i + 1)     <= valid(i);
          if rst = '1' then
            valid(i + 1) <= '0';
          end if;
        end if;
      end process;
    end generate;

  end generate;

  round_p : process (clk)
    variable magnitude : unsigned(G_QUOTIENT_WIDTH - 2 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      magnitude := bits(STEPS)(G_QUOTIENT_WIDTH - 1 downto 1);
      if bits(STEPS)(G_QUOTIENT_WIDTH) = '1' then
        magnitude := (others => '1');
      elsif bits(STEPS)(0) = '1' and not magnitude /= 0 then
        magnitude := magnitude + 1;
      end if;
      if negative(STEPS) = '1' then
        quotient <= std_ulogic_vector(not ('0' & magnitude) + 1);
      else
        quotient <= std_ulogic_vector('0' & magnitude);
      end if;
      out_valid <= valid(STEPS);
      if rst = '1' then
        out_valid <= '0';
      end if;
    end if;
  end process;

end architecture;
