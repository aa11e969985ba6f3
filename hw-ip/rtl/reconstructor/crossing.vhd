-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Where two rays cross in the plane of along and up, one pair per clock.
--
-- Purpose     two cameras, or one camera and the beam: the distance along the beam and the reciprocal of the slopes' difference
-- Latency     crossing_latency(G_BITS_PER_STAGE) = 11 + ceil(17 / G_BITS_PER_STAGE); the reciprocal 2 clocks before that
-- Throughput  one per clock. No reset: data only
-- Resources   one multiplier of 33 x 33 bits, one exact reciprocal
-- Twin        karst_core's fusion.rs: stereo, mono

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.rounding.all;
use work.reconstructor_pkg.all;

entity crossing is
  generic (
    G_BITS_PER_STAGE : positive range 1 to 4  -- of the division
  );
  port (
    clk           : in  std_ulogic;           -- rising edge
    enable        : in  std_ulogic;           -- registers move
    single        : in  std_ulogic;           -- the second ray is the beam
    up_slope_a    : in  signed(30 downto 0);  -- first ray, Q4.28
    up_a          : in  signed(27 downto 0);  -- first ray, mm, Q.16
    up_slope_b    : in  signed(30 downto 0);  -- second ray, Q4.28; zero if it is the beam
    up_b          : in  signed(27 downto 0);  -- second ray, mm, Q.16; zero if it is the beam
    exists        : out std_ulogic;           -- they cross in reach
    along         : out signed(29 downto 0);  -- of the crossing, mm, Q.16
    falls         : out std_ulogic;           -- slope of the first - slope of the second is negative; a clock before the
                                              -- inverse
    inverse       : out unsigned(31 downto 0);  -- 2 ** 63 over the magnitude of that difference, shifted; see shift
    shift         : out unsigned(3 downto 0)    -- by how many bits the magnitude in Q.28 is shifted to the left, 1 to 9
  );
end entity;

architecture rtl of crossing is

  constant T_SLOPE    : positive := 1;
  constant T_SHIFT    : positive := T_SLOPE + 2;
  constant T_INVERSE  : positive := T_SLOPE + exact_reciprocal_latency(G_BITS_PER_STAGE);
  constant T_CROSSING : positive := crossing_latency(G_BITS_PER_STAGE);

  -- 1/32, and 1/64 for the beam, in Q.28
  constant LEAST_DIFFERENCE : unsigned(23 downto 0) := to_unsigned(2 ** 23, 24);
  constant LEAST_SLOPE      : unsigned(23 downto 0) := to_unsigned(2 ** 22, 24);
  signal difference : signed(31 downto 0);
  signal opposite   : signed(31 downto 0);
  signal slope      : unsigned(30 downto 0);  -- magnitude
  signal magnitude_32 : unsigned(31 downto 0);
  signal rise         : signed(28 downto 0);    -- mm, Q.16; the other way round if the slope is negative
  signal is_single    : std_ulogic;
  signal meets        : std_ulogic;
  signal shift_here   : unsigned(4 downto 0);
  signal shift_line   : signed(3 downto 0);
  signal shift_late   : signed(3 downto 0);
  signal rise_at_shift : signed(28 downto 0);
  signal rise_shifted : signed(32 downto 0);
  signal rise_late    : signed(32 downto 0);
  signal inverse_here : unsigned(31 downto 0);
  signal factor       : signed(32 downto 0);
  signal product      : signed(65 downto 0);
  signal distance     : signed(31 downto 0);

  signal meets_line : signed(0 downto 0);
  signal meets_late : signed(0 downto 0);
  signal falls_line : signed(0 downto 0);
  signal falls_late : signed(0 downto 0);

begin

  difference <= resize(up_slope_a, 32) - up_slope_b;
  opposite   <= resize(up_slope_b, 32) - up_slope_a;

  lines_p : process (clk)
    variable least : unsigned(23 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      if difference(31) = '1' then
        slope <= unsigned(opposite(30 downto 0));
        rise  <= resize(up_a, 29) - up_b;
      else
        slope <= unsigned(difference(30 downto 0));
        rise  <= resize(up_b, 29) - up_a;
      end if;
      falls_line(0) <= difference(31);
      is_single     <= single;

      least := LEAST_SLOPE when is_single = '1' else LEAST_DIFFERENCE;
      -- In reach the rise is positive, and at most 8192 mm times the slope
      meets <= '1' when slope >= least and rise(28) = '0' and unsigned(rise(27 downto 0)) <= (slope & '0') else '0';

      -- Below 2 ** 32 if they meet in reach
      rise_shifted <= '0' & shift_left(resize(rise_at_shift, 32), to_integer(shift_here(3 downto 0) - 1));
    end if;
  end process;

  magnitude_32 <= resize(slope, 32);
  reciprocal_i : entity work.reciprocal
    generic map (G_EXACT => true, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, value => magnitude_32, shift => shift_here, inverse => inverse_here);
  factor  <= signed('0' & inverse_here);
  inverse <= inverse_here;
  shift_line <= signed(shift_here(3 downto 0));
  shift_i : entity work.delay
    generic map (G_WIDTH => 4, G_CLOCKS => T_INVERSE - T_SHIFT)
    port map (clk => clk, enable => enable, value => shift_line, later => shift_late);
  shift <= unsigned(shift_late);

  rise_i : entity work.delay
    generic map (G_WIDTH => 29, G_CLOCKS => T_SHIFT - T_SLOPE)
    port map (clk => clk, enable => enable, value => rise, later => rise_at_shift);
  rise_late_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_INVERSE - T_SHIFT - 1)
    port map (clk => clk, enable => enable, value => rise_shifted, later => rise_late);
  product_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => rise_late, b => factor, product => product);

  meets_line(0) <= meets;
  meets_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_CROSSING - T_SLOPE - 1)
    port map (clk => clk, enable => enable, value => meets_line, later => meets_late);
  falls_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_INVERSE - 1 - T_SLOPE)
    port map (clk => clk, enable => enable, value => falls_line, later => falls_late);
  falls <= falls_late(0);

  distance <= product(65 downto 34);
  exists   <= '1' when meets_late(0) = '1' and in_reach(distance) else '0';
  along    <= distance(29 downto 0);

end architecture;
