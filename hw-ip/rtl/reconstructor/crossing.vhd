-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Where two rays cross in the plane of along and up, one pair per clock.
--
-- Purpose     two cameras, or one camera and the beam: the distance along the beam and the inverse of the slopes' difference
-- Latency     crossing_latency(G_BITS_PER_STAGE) = 4 + ceil(35 / G_BITS_PER_STAGE); the inverse 2 clocks before that
-- Throughput  one per clock. No reset: data only
-- Resources   one multiplier of 33 x 36 bits, one quotient of 35 bits
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
    up_a          : in  signed(31 downto 0);  -- first ray, mm, Q12.20
    up_slope_b    : in  signed(30 downto 0);  -- second ray, Q4.28; zero if it is the beam
    up_b          : in  signed(31 downto 0);  -- second ray, mm, Q12.20; zero if it is the beam
    exists        : out std_ulogic;           -- they cross in reach
    along         : out signed(29 downto 0);  -- of the crossing, mm, Q.16
    falls         : out std_ulogic;           -- slope of the first - slope of the second is negative; a clock before the
                                              -- inverse
    inverse_slope : out signed(35 downto 0)   -- 1 / (slope of the first - slope of the second), magnitude, Q.28
  );
end entity;

architecture rtl of crossing is

  constant T_SLOPE    : positive := 1;
  constant T_INVERSE  : positive := T_SLOPE + quotient_latency(35, G_BITS_PER_STAGE);
  constant T_CROSSING : positive := crossing_latency(G_BITS_PER_STAGE);

  -- 1/32, and 1/64 for the beam, in Q.28
  constant LEAST_DIFFERENCE : unsigned(23 downto 0) := to_unsigned(2 ** 23, 24);
  constant LEAST_SLOPE      : unsigned(23 downto 0) := to_unsigned(2 ** 22, 24);
  -- 2 ** 56
  constant ONE : signed(57 downto 0) := (56 => '1', others => '0');
  -- Half of the last bit of the distance
  constant HALF : signed(68 downto 0) := (31 => '1', others => '0');

  signal difference : signed(31 downto 0);
  signal opposite   : signed(31 downto 0);
  signal slope      : unsigned(30 downto 0);  -- magnitude
  signal rise       : signed(32 downto 0);    -- the other way round if the slope is negative
  signal is_single  : std_ulogic;
  signal meets      : std_ulogic;
  signal inverse    : unsigned(34 downto 0);
  signal rise_late  : signed(32 downto 0);
  signal factor     : signed(35 downto 0);
  signal product    : signed(68 downto 0);
  signal distance   : signed(36 downto 0);

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
        rise  <= resize(up_a, 33) - up_b;
      else
        slope <= unsigned(difference(30 downto 0));
        rise  <= resize(up_b, 33) - up_a;
      end if;
      falls_line(0) <= difference(31);
      is_single     <= single;

      least := LEAST_SLOPE when is_single = '1' else LEAST_DIFFERENCE;
      -- In reach the rise is positive, and at most 32 times the slope
      meets <= '1' when slope >= least and rise(32) = '0' and unsigned(rise(31 downto 0)) <= (slope & "00000") else '0';
    end if;
  end process;

  quotient_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 58, G_DIVISOR_WIDTH => 31, G_QUOTIENT_WIDTH => 35,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, numerator => ONE, divisor => slope, negative => open, magnitude => inverse);
  factor        <= signed('0' & inverse);
  inverse_slope <= factor;

  rise_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_INVERSE - T_SLOPE)
    port map (clk => clk, enable => enable, value => rise, later => rise_late);
  -- Q.20 times Q.28, kept at Q.16
  product_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 36)
    port map (clk => clk, enable => enable, a => rise_late, b => factor, addend => HALF, product => product);

  meets_line(0) <= meets;
  meets_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_CROSSING - T_SLOPE - 1)
    port map (clk => clk, enable => enable, value => meets_line, later => meets_late);
  falls_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_INVERSE - 1 - T_SLOPE)
    port map (clk => clk, enable => enable, value => falls_line, later => falls_late);
  falls <= falls_late(0);

  distance <= product(68 downto 32);
  exists   <= '1' when meets_late(0) = '1' and in_reach(distance) else '0';
  along    <= distance(29 downto 0);

end architecture;
