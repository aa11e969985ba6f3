-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Signed division with rounding in little area, one at a time.
--
-- Purpose     the results of divide where one every few dozen clocks is enough
-- Method      non-restoring on the magnitudes, one bit of the quotient per clock
-- Latency     G_QUOTIENT_WIDTH + 4 from the clock that takes the operands
-- Throughput  one per latency + 1
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_math::div_round, clamped to the quotient's width

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity divide_sequential is
  generic (
    G_NUMERATOR_WIDTH   : positive range 3 to 64 := 64;  -- bits of the numerator, sign included
    G_DENOMINATOR_WIDTH : positive range 2 to 64 := 64;  -- bits of the denominator, sign included
    G_QUOTIENT_WIDTH    : positive range 3 to 64 := 64   -- bits of the quotient, sign included, at most the numerator's
  );
  port (
    clk         : in  std_ulogic;                                           -- rising edge
    rst         : in  std_ulogic;                                           -- synchronous, high: forgets what is under way
    in_valid    : in  std_ulogic;                                           -- operands are there
    in_ready    : out std_ulogic;                                           -- operands are taken if they are there
    numerator   : in  std_ulogic_vector(G_NUMERATOR_WIDTH - 1 downto 0);    -- signed
    denominator : in  std_ulogic_vector(G_DENOMINATOR_WIDTH - 1 downto 0);  -- signed
    out_valid   : out std_ulogic;                                           -- quotient is there, until it is taken
    out_ready   : in  std_ulogic;                                           -- quotient is taken if it is there
    quotient    : out std_ulogic_vector(G_QUOTIENT_WIDTH - 1 downto 0)      -- signed
  );
end entity;

architecture rtl of divide_sequential is

  constant STEPS     : positive := G_QUOTIENT_WIDTH + 1;
  constant HIGH_BITS : positive := G_NUMERATOR_WIDTH - G_QUOTIENT_WIDTH + 1;
  constant REST_BITS : positive := G_QUOTIENT_WIDTH - 1;
  constant WIDTH     : positive := maximum(G_DENOMINATOR_WIDTH, HIGH_BITS + 1);

  signal high      : unsigned(HIGH_BITS - 1 downto 0);          -- the part of the numerator that must be below the divisor
  signal remainder : unsigned(WIDTH - 1 downto 0);              -- two's complement
  signal divisor   : unsigned(G_DENOMINATOR_WIDTH - 1 downto 0);
  signal rest      : unsigned(REST_BITS downto 0);              -- the bits of the numerator to come, and a zero for the half
  signal bits      : unsigned(STEPS - 1 downto 0);              -- the bits of the quotient so far
  signal negative  : std_ulogic;

  -- STEPS + 1: take the magnitudes; STEPS: overflow bit; ... 1: half; 0: round
  signal steps_left : natural range 0 to STEPS + 1;
  signal busy       : std_ulogic;
  signal done       : std_ulogic;

  signal shifted            : unsigned(WIDTH - 1 downto 0);
  signal subtract           : std_ulogic;
  signal divisor_or_inverse : unsigned(WIDTH - 1 downto 0);
  signal sum                : unsigned(WIDTH downto 0);  -- the lowest bit only makes the borrow

begin

  shifted            <= resize(high, WIDTH) when steps_left = STEPS else
                        remainder(WIDTH - 2 downto 0) & rest(REST_BITS);
  -- Always a subtraction: r + d = r - not d - 1. yosys then needs one LUT per bit, for an addition two
  subtract           <= '1' when steps_left = STEPS else not remainder(WIDTH - 1);
  divisor_or_inverse <= resize(divisor, WIDTH) when subtract = '1' else not resize(divisor, WIDTH);
  sum                <= (shifted & '0') - (divisor_or_inverse & not subtract);

  step_p : process (clk)
    variable magnitude : unsigned(G_QUOTIENT_WIDTH - 2 downto 0);
    variable n         : unsigned(G_NUMERATOR_WIDTH - 1 downto 0);
  begin
    if rising_edge(clk) then
      if busy = '1' then
        if steps_left > 0 then
          steps_left <= steps_left - 1;
        end if;
        if steps_left = STEPS + 1 then
          n := high & rest(REST_BITS downto 1);
          if n(n'high) = '1' then
            n    := not n + 1;
            high <= n(n'high downto REST_BITS);
            rest <= n(REST_BITS - 1 downto 0) & '0';
          end if;
          if divisor(divisor'high) = '1' then
            divisor <= not divisor + 1;
          end if;
        elsif steps_left > 0 then
          remainder <= sum(WIDTH downto 1);
          bits      <= bits(STEPS - 2 downto 0) & not sum(WIDTH);
          if steps_left < STEPS then
            rest <= shift_left(rest, 1);
          end if;
        else
          magnitude := bits(G_QUOTIENT_WIDTH - 1 downto 1);
          if bits(G_QUOTIENT_WIDTH) = '1' then
            magnitude := (others => '1');
          elsif bits(0) = '1' and not magnitude /= 0 then
            magnitude := magnitude + 1;
          end if;
          if negative = '1' then
            quotient <= std_ulogic_vector(not ('0' & magnitude) + 1);
          else
            quotient <= std_ulogic_vector('0' & magnitude);
          end if;
          busy <= '0';
          done <= '1';
        end if;
      elsif done = '1' then
        done <= not out_ready;
      elsif in_valid = '1' then
        high       <= unsigned(numerator(numerator'high downto REST_BITS));
        rest       <= unsigned(numerator(REST_BITS - 1 downto 0)) & '0';
        divisor    <= unsigned(denominator);
        negative   <= numerator(numerator'high) xor denominator(denominator'high);
        steps_left <= STEPS + 1;
        busy       <= '1';
      end if;
      if rst = '1' then
        busy <= '0';
        done <= '0';
      end if;
    end if;
  end process;

  in_ready  <= not busy and not done;
  out_valid <= done;

end architecture;
