-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Integer square root, one result per clock.
--
-- Purpose     root of an unsigned integer: rounded down, or to the nearest integer with saturation
-- Method      non-restoring, one adder per bit of the root, G_BITS_PER_STAGE bits between two registers. Rounding takes
--             one bit more, the half: a tie cannot occur
-- Latency     ceil(ceil(G_WIDTH / 2) / G_BITS_PER_STAGE); if G_ROUND, ceil((ceil(G_WIDTH / 2) + 1) / G_BITS_PER_STAGE) + 1
-- Throughput  one per clock, no stall
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_math::sqrt_floor, karst_math::sqrt_round

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity sqrt is
  generic (
    G_WIDTH          : positive range 2 to 64 := 64;     -- bits of the radicand
    G_ROUND          : boolean                := false;  -- round to the nearest integer instead of down
    G_BITS_PER_STAGE : positive range 1 to 8  := 1       -- more: fewer clocks, but longer ones
  );
  port (
    clk       : in  std_ulogic;                                  -- rising edge
    enable    : in  std_ulogic := '1';                           -- registers move; if not, a reset does nothing either
    rst       : in  std_ulogic;                                  -- synchronous, high: forgets what is under way
    in_valid  : in  std_ulogic;                                  -- radicand is there
    radicand  : in  std_ulogic_vector(G_WIDTH - 1 downto 0);     -- unsigned
    out_valid : out std_ulogic;                                  -- root is there
    root      : out std_ulogic_vector((G_WIDTH + 1) / 2 - 1 downto 0) -- unsigned
  );
end entity;

architecture rtl of sqrt is

  constant ROOT_BITS : positive := (G_WIDTH + 1) / 2;
  constant STEPS     : positive := ROOT_BITS + boolean'pos(G_ROUND);

  subtype remainder_t is unsigned(STEPS + 1 downto 0);  -- two's complement
  subtype partial_t   is unsigned(STEPS - 1 downto 0);
  subtype rest_t      is unsigned(2 * STEPS - 1 downto 0);

  type remainder_array_t is array (natural range <>) of remainder_t;
  type partial_array_t   is array (natural range <>) of partial_t;
  type rest_array_t      is array (natural range <>) of rest_t;

  -- Index 0 is the input, index i what step i makes of it
  signal remainder : remainder_array_t(0 to STEPS);
  signal partial   : partial_array_t(0 to STEPS);  -- the bits of the root so far, at the low end
  signal rest      : rest_array_t(0 to STEPS);     -- the bits of the radicand to come, at the high end
  signal valid     : std_ulogic_vector(0 to STEPS);

begin

  valid(0)     <= in_valid;
  remainder(0) <= (others => '0');
  partial(0)   <= (others => '0');
  rest(0)      <= shift_left(resize(unsigned(radicand), 2 * STEPS), 2 * (STEPS - ROOT_BITS));

  steps_g : for i in 0 to STEPS - 1 generate
    -- remainder' = 4 remainder + pair - (4 root + 1) after a positive remainder, ... + (4 root + 3) after a negative one.
    -- Either way the low two bits are pair - 1. The others are remainder - root, less 1 if pair is zero, or
    -- remainder + root, plus 1 if it is not. Always a subtraction, a + b = a - not b - 1: yosys then needs one LUT per
    -- bit, for an addition two.
    signal root_or_inverse : unsigned(i downto 0);
    signal pair            : unsigned(1 downto 0);
    signal sum             : unsigned(i + 1 downto 0);  -- the lowest bit only makes the borrow
    signal next_remainder  : remainder_t;
  begin

    pair            <= rest(i)(2 * STEPS - 1 downto 2 * STEPS - 2);
    root_or_inverse <= not partial(i)(i downto 0) when remainder(i)(i + 1) = '1' else partial(i)(i downto 0);
    sum             <= (remainder(i)(i downto 0) & '0') - (root_or_inverse & (pair(1) nor pair(0)));

    -- Between - 2 root - 1 and 2 root: one bit more than the root, and a sign
    next_remainder <= resize(sum(i + 1 downto 1) & (pair(1) xnor pair(0)) & not pair(0), STEPS + 2);

    wires_g : if (i + 1) mod G_BITS_PER_STAGE /= 0 and i + 1 /= STEPS generate
      valid(i + 1)     <= valid(i);
      remainder(i + 1) <= next_remainder;
      partial(i + 1)   <= partial(i)(STEPS - 2 downto 0) & not sum(i + 1);
      rest(i + 1)      <= shift_left(rest(i), 2);
    end generate;

    registers_g : if (i + 1) mod G_BITS_PER_STAGE = 0 or i + 1 = STEPS generate
      step_p : process (clk)
      begin
        if rising_edge(clk) and enable = '1' then
          valid(i + 1)     <= valid(i);
          remainder(i + 1) <= next_remainder;
          partial(i + 1)   <= partial(i)(STEPS - 2 downto 0) & not sum(i + 1);
          rest(i + 1)      <= shift_left(rest(i), 2);
          if rst = '1' then
            valid(i + 1) <= '0';
          end if;
        end if;
      end process;
    end generate;

  end generate;

  floor_g : if not G_ROUND generate
    out_valid <= valid(STEPS);
    root      <= std_ulogic_vector(partial(STEPS));
  end generate;

  round_g : if G_ROUND generate
    round_p : process (clk)
      variable floor : unsigned(ROOT_BITS - 1 downto 0);
    begin
      if rising_edge(clk) and enable = '1' then
        floor := partial(STEPS)(STEPS - 1 downto 1);
        if partial(STEPS)(0) = '1' and not floor /= 0 then
          root <= std_ulogic_vector(floor + 1);
        else
          root <= std_ulogic_vector(floor);
        end if;
        out_valid <= valid(STEPS);
        if rst = '1' then
          out_valid <= '0';
        end if;
      end if;
    end process;
  end generate;

end architecture;
