-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Angle of a point, one result per clock.
--
-- Purpose     atan2 in turns; 0 at the origin
-- Method      the ratio of the smaller coordinate to the larger one is a product with a reciprocal; reciprocal and
--             arctangent come from a table of 256 segments each and a straight line within the segment
-- Latency     18: magnitudes 1, comparison 1, order 1, place of the highest bit 1, shift 1, reciprocal 6, ratio 1,
--             arctangent 5, eighth of the turn 1
-- Throughput  one per clock, no stall. No reset: it has no state
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_math::azimuth, for coordinates that need no clamping

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity azimuth is
  generic (
    G_BITS : positive range 8 to 16 := 16  -- coordinates are above -2 ** G_BITS and below 2 ** G_BITS
  );
  port (
    clk      : in  std_ulogic;                          -- rising edge
    reversed : in  std_ulogic;                          -- gives the negative angle
    x        : in  std_ulogic_vector(G_BITS downto 0);  -- signed, any one unit
    y        : in  std_ulogic_vector(G_BITS downto 0);  -- signed, the unit of x
    angle    : out std_ulogic_vector(15 downto 0)       -- from the x axis towards the y axis, 2 ** -16 turn
  );
end entity;

architecture rtl of azimuth is

  -- Start of a segment, and how far away the end is: below it for reciprocals, above it for arctangents. Both tables are in one
  -- memory with two ports, the arctangents behind the reciprocals
  subtype segment_t is std_ulogic_vector(28 downto 0);
  type table_t is array (511 downto 0) of segment_t;

  -- Angle of the ratio i / 256 in 2 ** -21 turn, by Euler's series
  function arctangent(i : natural) return natural is
    constant TURN : real := 2.0 * 3.14159265358979323846;
    variable t    : real;
    variable term : real;
    variable sum  : real;
  begin
    t    := real(i) / 256.0;
    term := t / (1.0 + t * t);
    sum  := 0.0;
    for n in 1 to 40 loop
      sum  := sum + term;
      term := term * t * t / (1.0 + t * t) * real(2 * n) / real(2 * n + 1);
    end loop;
    return integer(sum / TURN * 2.0 ** 21);
  end function;

  function segments return table_t is
    variable table      : table_t;
    variable start, stop : natural;
  begin
    for i in 0 to 255 loop
      -- 2 ** 33 / h at the ends of the segments of h, from 2 ** 15 to 2 ** 16
      start    := 2 ** 26 / (256 + i) - 2;
      stop     := 2 ** 26 / (257 + i) - 2;
      table(i) := std_ulogic_vector(to_unsigned(abs (stop - start), 11)) & std_ulogic_vector(to_unsigned(start, 18));
      -- 18 is a half for rounding to 2 ** -16 turn and a little for what the steps before it cut off
      start := arctangent(i);
      stop  := arctangent(i + 1);
      table(256 + i) := std_ulogic_vector(to_unsigned(abs (stop - start), 11)) & std_ulogic_vector(to_unsigned(start + 18, 18));
    end loop;
    return table;
  end function;

  constant TABLE : table_t := segments;

  constant LATENCY : positive := 18;

  subtype magnitude_t is unsigned(G_BITS - 1 downto 0);
  type word_array_t is array (natural range <>) of unsigned(15 downto 0);

  -- Index: the stage that reads it
  signal x_negative : std_ulogic_vector(2 to LATENCY - 1);
  signal y_negative : std_ulogic_vector(2 to LATENCY - 1);
  signal swapped    : std_ulogic_vector(3 to LATENCY - 1);

  signal x_2, y_2               : magnitude_t;
  signal x_3, y_3               : magnitude_t;
  signal larger_4, smaller_4    : magnitude_t;
  signal above_4                : magnitude_t;                 -- for each bit: there is a higher one in one of the two
  signal larger_5, smaller_5    : magnitude_t;
  signal highest_5              : magnitude_t;                 -- 2 ** (zeros above the highest bit of the larger one)
  signal larger_6, smaller_6    : unsigned(2 * G_BITS - 1 downto 0);
  signal smaller_at             : word_array_t(7 to 12);
  signal segment_7              : segment_t;
  signal segment_8              : segment_t;
  signal segment_9              : segment_t;
  signal part_7, part_8, part_9 : unsigned(6 downto 0);
  signal start_10, start_11     : unsigned(17 downto 0);
  signal product_10, product_11 : unsigned(17 downto 0);
  signal reciprocal_12          : unsigned(17 downto 0);
  signal ratio_13               : unsigned(33 downto 0);
  signal segment_14             : segment_t;
  signal segment_15             : segment_t;
  signal segment_16             : segment_t;
  signal part_14, part_15       : unsigned(9 downto 0);
  signal part_16                : unsigned(9 downto 0);
  signal start_17               : unsigned(18 downto 0);
  signal product_17             : unsigned(20 downto 0);
  signal eighth_18              : unsigned(18 downto 0);
  signal is_plus_18             : std_ulogic;
  signal quarters_18            : unsigned(1 downto 0);

begin

  signs_p : process (clk)
  begin
    if rising_edge(clk) then
      x_negative <= x(x'high) & x_negative(2 to LATENCY - 2);
      y_negative <= y(y'high) & y_negative(2 to LATENCY - 2);
      swapped    <= '0' & swapped(3 to LATENCY - 2);
      if x_2 < y_2 then
        swapped(3) <= '1';
      end if;
    end if;
  end process;

  eighth_p : process (clk)
    variable x_minus, y_minus : unsigned(G_BITS + 1 downto 0);
    variable above            : std_ulogic;
    variable larger           : unsigned(15 downto 0);
  begin
    if rising_edge(clk) then
      -- 1: magnitudes: zero minus a number, or minus its complement and one. Always a subtraction: one LUT per bit
      x_minus := 0 - ((unsigned(x) xor (x'range => not x(x'high))) & not x(x'high));
      y_minus := 0 - ((unsigned(y) xor (y'range => not y(y'high))) & not y(y'high));
      x_2     <= x_minus(G_BITS downto 1);
      y_2     <= y_minus(G_BITS downto 1);

      -- 2: comparison
      x_3 <= x_2;
      y_3 <= y_2;

      -- 3: in order; which bits are below the highest
      if swapped(3) = '1' then
        larger_4  <= y_3;
        smaller_4 <= x_3;
      else
        larger_4  <= x_3;
        smaller_4 <= y_3;
      end if;
      above := '0';
      for i in G_BITS - 1 downto 0 loop
        above_4(i) <= above;
        above      := above or x_3(i) or y_3(i);
      end loop;

      -- 4: where the highest bit is
      for i in 0 to G_BITS - 1 loop
        highest_5(i) <= larger_4(G_BITS - 1 - i) and not above_4(G_BITS - 1 - i);
      end loop;
      larger_5  <= larger_4;
      smaller_5 <= smaller_4;

      -- 5: both shifted until it is the highest bit of all
      larger_6  <= larger_5 * highest_5;
      smaller_6 <= smaller_5 * highest_5;

      -- 6 to 11: reciprocal
      larger                               := (others => '0');
      larger(15 downto 16 - G_BITS)        := larger_6(G_BITS - 1 downto 0);
      segment_7                            <= TABLE(to_integer('0' & larger(14 downto 7)));
      part_7                               <= larger(6 downto 0);
      smaller_at                           <= to_unsigned(0, 16) & smaller_at(7 to 11);
      smaller_at(7)(15 downto 16 - G_BITS) <= smaller_6(G_BITS - 1 downto 0);
      segment_8                            <= segment_7;
      part_8                               <= part_7;
      segment_9                            <= segment_8;
      part_9                               <= part_8;
      product_10                           <= unsigned(segment_9(28 downto 18)) * part_9;
      start_10                             <= unsigned(segment_9(17 downto 0));
      product_11                           <= product_10;
      start_11                             <= start_10;
      reciprocal_12                        <= start_11 - product_11(17 downto 7);

      -- 12: ratio, below 2 ** 33
      ratio_13 <= smaller_at(12) * reciprocal_12;

      -- 13 to 17: arctangent
      segment_14 <= TABLE(to_integer('1' & ratio_13(32 downto 25)));
      part_14    <= ratio_13(24 downto 15);
      segment_15 <= segment_14;
      part_15    <= part_14;
      segment_16 <= segment_15;
      part_16    <= part_15;
      product_17 <= unsigned(segment_16(28 downto 18)) * part_16;
      start_17   <= unsigned('0' & segment_16(17 downto 0));
      eighth_18  <= start_17 + product_17(20 downto 10);
    end if;
  end process;

  -- 17, 18: mirrored where the point is: a whole number of quarters, plus or minus the angle of the first eighth
  turn_p : process (clk)
    variable is_below : std_ulogic;
    variable eighth   : unsigned(15 downto 0);
    variable turned   : unsigned(16 downto 0);
  begin
    if rising_edge(clk) then
      is_below    := y_negative(LATENCY - 1) xor reversed;
      is_plus_18  <= not (swapped(LATENCY - 1) xor x_negative(LATENCY - 1) xor is_below);
      quarters_18 <= (is_below and swapped(LATENCY - 1)) & swapped(LATENCY - 1);
      if swapped(LATENCY - 1) = '0' then
        quarters_18(1) <= x_negative(LATENCY - 1);
      end if;
      eighth := resize(eighth_18(18 downto 5), 16);
      turned := (quarters_18 & (14 downto 0 => '0')) - ((eighth xor (15 downto 0 => is_plus_18)) & is_plus_18);
      angle  <= std_ulogic_vector(turned(16 downto 1));
    end if;
  end process;

end architecture;
