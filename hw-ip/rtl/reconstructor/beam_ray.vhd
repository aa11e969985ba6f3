-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Ray in the camera's frame to ray in the frame of a laser beam, one per clock.
--
-- Purpose     the ray as two straight lines over the distance along the beam, with what its variance needs
-- Latency     beam_ray_latency(G_BITS_PER_STAGE) = 17 + ceil(17 / G_BITS_PER_STAGE)
-- Throughput  one per clock. No reset: data only
-- Resources   18 multipliers of about 32 bits, one exact reciprocal
-- Twin        karst_core::BeamRay::new

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.rounding.all;
use work.reconstructor_pkg.all;

entity beam_ray is
  generic (
    G_BITS_PER_STAGE : positive range 1 to 4  -- of the division
  );
  port (
    clk                  : in  std_ulogic;           -- rising edge
    enable               : in  std_ulogic;           -- registers move
    frame                : in  words_t(0 to FRAME_WORDS - 1);  -- the ray's camera as seen from its laser
    direction_x          : in  signed(31 downto 0);  -- px, Q12.20
    direction_y          : in  signed(31 downto 0);  -- px, Q12.20
    direction_z          : in  signed(31 downto 0);  -- px, Q12.20
    start                : in  signed(31 downto 0);  -- on the camera's axis, mm, Q18.14
    direction_derivative : in  signed(31 downto 0);  -- of direction_z, by the radius, Q12.20
    start_derivative     : in  signed(31 downto 0);  -- of start, by the radius, mm, Q24.8
    variance             : in  signed(24 downto 0);  -- of the spot, px**2, Q.24, 0 to 1
    exists               : out std_ulogic;           -- the ray points outwards along the beam, and not too steeply
    ray                  : out beam_ray_t            -- the ray, if it exists
  );
end entity;

architecture rtl of beam_ray is

  constant T_ROTATED : positive := 3;
  constant T_SHIFT   : positive := T_ROTATED + 2;
  constant T_INVERSE : positive := T_ROTATED + exact_reciprocal_latency(G_BITS_PER_STAGE);
  constant T_SLOPE   : positive := T_INVERSE + 3;
  constant T_RAY     : positive := beam_ray_latency(G_BITS_PER_STAGE);

  -- Least and largest component along the beam, px in Q.18: 64 px, and what a rotation does not reach
  constant LEAST_ALONG : signed(31 downto 0) := (24 => '1', others => '0');
  constant MOST_ALONG  : signed(31 downto 0) := (30 => '1', others => '0');

  type products_t is array (natural range <>) of signed(63 downto 0);
  type lines_t    is array (0 to 1) of signed(62 downto 0);
  type slopes_t   is array (0 to 1) of signed(30 downto 0);
  type factors_t  is array (0 to 1) of signed(31 downto 0);
  type by_along_t is array (0 to 1) of signed(64 downto 0);

  signal direction       : words_t(0 to 2);
  signal products        : products_t(0 to 8);
  signal offset          : signed(31 downto 0);   -- start, Q.18
  signal start_products  : products_t(0 to 2);
  signal viewpoint       : words_t(0 to 2);
  signal rotation_z      : words_t(0 to 2);
  signal rotated         : words_t(0 to 2);       -- along, up, across: px, Q.18
  signal starts          : words_t(0 to 2);       -- mm, Q.16
  signal starts_late     : words_t(0 to 2);
  signal line_starts     : words_t(0 to 1);       -- up and across, when the lines' products are there
  signal sensible        : std_ulogic;
  signal along           : unsigned(31 downto 0);
  signal shift           : unsigned(4 downto 0);
  signal shift_line      : signed(4 downto 0);
  signal shift_at_slope  : signed(4 downto 0);    -- a clock before it
  signal shift_late      : signed(4 downto 0);
  signal shift_at_ray    : signed(4 downto 0);    -- a clock before it
  signal inverse         : unsigned(31 downto 0);  -- 2 ** 63 / along, shifted
  signal factor          : signed(32 downto 0);
  signal inverse_line    : signed(31 downto 0);
  signal inverse_late    : signed(31 downto 0);
  signal factor_late     : signed(32 downto 0);
  signal lengths         : factors_t;             -- up and across, shifted
  signal lengths_at_shift : factors_t;
  signal lengths_late    : factors_t;
  signal slope_products  : by_along_t;
  signal slopes          : slopes_t;              -- up and across
  signal z               : signed(31 downto 0);
  signal z_product       : signed(64 downto 0);
  signal by_radius       : signed(31 downto 0);
  signal slope_change    : signed(31 downto 0);
  signal change_product  : signed(64 downto 0);
  signal lines           : lines_t;
  signal radius          : unsigned(16 downto 0);
  signal radius_line     : signed(17 downto 0);
  signal start_change    : signed(24 downto 0);

  signal exists_line : signed(0 downto 0);
  signal exists_late : signed(0 downto 0);

  -- To the right by 13 less a shift of 2 to 7, as to the left and by 12 to the right: GHDL 2.0 makes a logical shift of a
  -- signed one to the right
  function over(value : signed(32 downto 0); by : signed(4 downto 0)) return signed is
    variable wide : signed(38 downto 0);
  begin
    wide := shift_left(resize(value, 39), to_integer(unsigned(by(2 downto 0)) - 1));
    return wide(38 downto 12);
  end function;

begin

  direction <= (direction_x, direction_y, direction_z);

  rows_g : for i in 0 to 2 generate

    columns_g : for j in 0 to 2 generate
      product_i : entity work.multiply
        generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
        port map (clk => clk, enable => enable, a => frame(FRAME_ROTATION + 3 * i + j), b => direction(j),
                  product => products(3 * i + j));
    end generate;

    rotation_z(i) <= frame(FRAME_ROTATION + 3 * i + 2) when rising_edge(clk) and enable = '1';
    start_i : entity work.multiply
      generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
      port map (clk => clk, enable => enable, a => rotation_z(i), b => offset, product => start_products(i));
    viewpoint_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => T_ROTATED)
      port map (clk => clk, enable => enable, value => frame(FRAME_VIEWPOINT + i), later => viewpoint(i));
    starts_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => T_SLOPE - T_ROTATED - 1)
      port map (clk => clk, enable => enable, value => starts(i), later => starts_late(i));

  end generate;

  rotate_p : process (clk)
    variable twice   : unsigned(32 downto 0);
    variable limited : signed(27 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      limited := saturate(start, 28);
      offset  <= limited & "0000";
      for i in 0 to 2 loop
        -- Q.20 times Q.30, at Q.18; Q.18 times Q.30, at Q.16
        rotated(i) <= products(3 * i)(63 downto 32) + products(3 * i + 1)(63 downto 32) + products(3 * i + 2)(63 downto 32);
        starts(i)  <= start_products(i)(63 downto 32) + viewpoint(i)(31 downto 4);
      end loop;

      twice    := unsigned(rotated(0) & '0');
      sensible <= '1' when rotated(0) >= LEAST_ALONG and rotated(0) < MOST_ALONG and magnitude(rotated(1)) <= twice
                           and magnitude(rotated(2)) <= twice else '0';
    end if;
  end process;

  along <= unsigned(rotated(0));
  reciprocal_i : entity work.reciprocal
    generic map (G_EXACT => true, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, value => along, shift => shift, inverse => inverse);
  factor       <= signed('0' & inverse);
  inverse_line <= signed(inverse);
  inverse_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_SLOPE - T_INVERSE)
    port map (clk => clk, enable => enable, value => inverse_line, later => inverse_late);
  factor_late <= '0' & inverse_late;
  shift_line  <= signed(shift);
  shift_at_slope_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => T_SLOPE - 1 - T_SHIFT)
    port map (clk => clk, enable => enable, value => shift_line, later => shift_at_slope);
  shift_at_ray_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => T_RAY - T_SLOPE)
    port map (clk => clk, enable => enable, value => shift_at_slope, later => shift_at_ray);

  z_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_INVERSE)
    port map (clk => clk, enable => enable, value => direction_z, later => z);
  by_radius_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_SLOPE - 1)
    port map (clk => clk, enable => enable, value => direction_derivative, later => by_radius);
  z_product_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => z, b => factor, product => z_product);
  change_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => slope_change, b => factor_late, product => change_product);

  lines_g : for i in 0 to 1 generate
    signal height : signed(31 downto 0);
  begin

    length_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => T_SHIFT - T_ROTATED)
      port map (clk => clk, enable => enable, value => rotated(i + 1), later => lengths_at_shift(i));
    -- At most twice the component along the beam, if the ray is sensible: that much shorter a shift
    lengths(i) <= shift_left(lengths_at_shift(i), to_integer(shift(2 downto 0) - 2)) when rising_edge(clk) and enable = '1';
    length_late_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => T_INVERSE - T_SHIFT - 1)
      port map (clk => clk, enable => enable, value => lengths(i), later => lengths_late(i));
    slope_i : entity work.multiply
      generic map (G_A_WIDTH => 32, G_B_WIDTH => 33)
      port map (clk => clk, enable => enable, a => lengths_late(i), b => factor, product => slope_products(i));
    slopes(i) <= slope_products(i)(63 downto 33) when rising_edge(clk) and enable = '1';

    line_i : entity work.multiply
      generic map (G_A_WIDTH => 31, G_B_WIDTH => 32)
      port map (clk => clk, enable => enable, a => slopes(i), b => starts_late(0), product => lines(i));
    line_start_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => 2)
      port map (clk => clk, enable => enable, value => starts_late(i + 1), later => line_starts(i));

  end generate;

  up_slope_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_RAY - T_SLOPE)
    port map (clk => clk, enable => enable, value => slopes(0), later => ray.up_slope);
  across_slope_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_RAY - T_SLOPE)
    port map (clk => clk, enable => enable, value => slopes(1), later => ray.across_slope);

  ray_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      -- With p = f / 512 px, the slope is p / s: its derivative is (p' - p / s) / s
      slope_change         <= saturate(resize(by_radius, 33) - over(z_product(64 downto 32), shift_at_slope), 32);
      ray.slope_derivative <= saturate(over(change_product(64 downto 32), shift_at_ray), 17);
      -- Q.28 times Q.16, at Q.15
      ray.up               <= saturate(resize(line_starts(0), 36) - (lines(0)(62 downto 29) & '0'), 28);
      ray.across           <= saturate(resize(line_starts(1), 36) - (lines(1)(62 downto 29) & '0'), 28);
      -- 1 / radius in Q.22, for which the radius is the component along the beam
      radius               <= resize(shift_right(unsigned(inverse_late), to_integer(23 - unsigned(shift_late))), 17);
    end if;
  end process;

  shift_late_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => 1)
    port map (clk => clk, enable => enable, value => shift_at_slope, later => shift_late);
  radius_line <= signed('0' & radius);
  inverse_radius_i : entity work.delay
    generic map (G_WIDTH => 18, G_CLOCKS => T_RAY - T_SLOPE - 1)
    port map (clk => clk, enable => enable, value => radius_line, later => ray.inverse_radius);

  -- Over 512 px, and from Q.8 to Q.10
  start_change <= start_derivative(31 downto 7);
  start_derivative_i : entity work.delay
    generic map (G_WIDTH => 25, G_CLOCKS => T_RAY)
    port map (clk => clk, enable => enable, value => start_change, later => ray.start_derivative);
  variance_i : entity work.delay
    generic map (G_WIDTH => 25, G_CLOCKS => T_RAY)
    port map (clk => clk, enable => enable, value => variance, later => ray.variance);
  exists_line(0) <= sensible;
  exists_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_RAY - T_ROTATED - 1)
    port map (clk => clk, enable => enable, value => exists_line, later => exists_late);
  exists <= exists_late(0);

end architecture;
