-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Ray in the camera's frame to ray in the frame of a laser beam, one per clock.
--
-- Purpose     the ray as two straight lines over the distance along the beam, with what its variance needs
-- Latency     beam_ray_latency(G_BITS_PER_STAGE) = 10 + ceil(33 / G_BITS_PER_STAGE)
-- Throughput  one per clock. No reset: data only
-- Resources   18 multipliers of about 32 bits, one quotient of 33 bits
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
  constant T_INVERSE : positive := T_ROTATED + quotient_latency(33, G_BITS_PER_STAGE);
  constant T_SLOPE   : positive := T_INVERSE + 3;
  constant T_RAY     : positive := beam_ray_latency(G_BITS_PER_STAGE);

  -- Smallest component along the beam, px in Q12.20: 64 px
  constant LEAST_ALONG : signed(33 downto 0) := (26 => '1', others => '0');
  -- Bits below the point
  constant LESS_28 : signed(27 downto 0) := (27 => '0', others => '1');
  -- 2 ** 58
  constant ONE : signed(59 downto 0) := (58 => '1', others => '0');

  type products_t   is array (natural range <>) of signed(63 downto 0);
  -- One of the products of a row brings the half that rounds their sum
  constant HALVES : products_t(0 to 2) := (0 => half(30, 64), others => (others => '0'));
  type components_t is array (natural range <>) of signed(32 downto 0);

  signal direction       : words_t(0 to 2);
  signal products        : products_t(0 to 8);
  signal start_products  : products_t(0 to 2);
  signal viewpoint       : words_t(0 to 2);
  signal rotated         : components_t(0 to 2);  -- along, up, across: px, Q13.20
  signal starts          : words_t(0 to 2);       -- mm, Q12.20
  signal sensible        : std_ulogic;
  signal divisor         : unsigned(31 downto 0);
  signal quotient        : unsigned(32 downto 0);
  signal inverse         : signed(33 downto 0);   -- 2 ** 58 / along, 2 ** 26 to 2 ** 32
  signal up, across      : signed(32 downto 0);
  signal z               : signed(31 downto 0);
  signal by_radius       : signed(31 downto 0);
  signal up_product      : signed(66 downto 0);
  signal across_product  : signed(66 downto 0);
  signal z_product       : signed(65 downto 0);
  signal inverse_part    : signed(17 downto 0);
  signal up_slope        : signed(30 downto 0);
  signal across_slope    : signed(30 downto 0);
  signal slope_change    : signed(31 downto 0);
  signal starts_late     : words_t(0 to 2);
  signal back            : signed(32 downto 0);  -- - starts_late(0)
  signal start_before    : signed(31 downto 0);  -- one clock before starts_late(0)
  signal line_addends    : products_t(0 to 1);
  signal up_line         : signed(63 downto 0);
  signal across_line     : signed(63 downto 0);
  signal inverse_late    : signed(33 downto 0);
  signal change_product  : signed(65 downto 0);
  signal start_change    : signed(24 downto 0);
  signal line_starts     : words_t(0 to 1);  -- up and across, one clock after starts_late

  signal exists_line : signed(0 downto 0);
  signal exists_late : signed(0 downto 0);

begin

  direction <= (direction_x, direction_y, direction_z);

  rows_g : for i in 0 to 2 generate

    columns_g : for j in 0 to 2 generate
      product_i : entity work.multiply
        generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
        port map (clk => clk, enable => enable, a => frame(FRAME_ROTATION + 3 * i + j), b => direction(j), addend => HALVES(j),
                  product => products(3 * i + j));
    end generate;

    start_i : entity work.multiply
      generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
      port map (clk => clk, enable => enable, a => frame(FRAME_ROTATION + 3 * i + 2), b => start, addend => half(24, 64),
                product => start_products(i));
    viewpoint_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => T_ROTATED - 1)
      port map (clk => clk, enable => enable, value => frame(FRAME_VIEWPOINT + i), later => viewpoint(i));
    starts_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => T_SLOPE - T_ROTATED)
      port map (clk => clk, enable => enable, value => starts(i), later => starts_late(i));

  end generate;

  rotate_p : process (clk)
    variable twice : unsigned(33 downto 0);
    variable row   : signed(65 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      for i in 0 to 2 loop
        -- Q.20 times Q.30, kept at Q.20. A rotation makes the length of three 32-bit components 33 bits at most
        row        := resize(products(3 * i), 66) + products(3 * i + 1) + products(3 * i + 2);
        rotated(i) <= row(62 downto 30);
        -- Q.14 times Q.30, kept at Q.20
        starts(i)  <= saturate(resize(start_products(i)(63 downto 24), 41) + viewpoint(i), 32);
      end loop;

      twice    := unsigned(rotated(0) & '0');
      sensible <= '1' when rotated(0) >= LEAST_ALONG and magnitude(rotated(1)) <= twice
                           and magnitude(rotated(2)) <= twice else '0';
    end if;
  end process;

  divisor <= unsigned(rotated(0)(31 downto 0));
  quotient_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 60, G_DIVISOR_WIDTH => 32, G_QUOTIENT_WIDTH => 33,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, numerator => ONE, divisor => divisor, negative => open, magnitude => quotient);
  inverse <= signed('0' & quotient);

  up_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_INVERSE - T_ROTATED)
    port map (clk => clk, enable => enable, value => rotated(1), later => up);
  across_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_INVERSE - T_ROTATED)
    port map (clk => clk, enable => enable, value => rotated(2), later => across);
  z_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_INVERSE)
    port map (clk => clk, enable => enable, value => direction_z, later => z);
  by_radius_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_SLOPE - 1)
    port map (clk => clk, enable => enable, value => direction_derivative, later => by_radius);
  up_product_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 34)
    port map (clk => clk, enable => enable, a => up, b => inverse, product => up_product);
  across_product_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 34)
    port map (clk => clk, enable => enable, a => across, b => inverse, product => across_product);
  z_product_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 34)
    port map (clk => clk, enable => enable, a => z, b => inverse, product => z_product);
  inverse_i : entity work.delay
    generic map (G_WIDTH => 34, G_CLOCKS => T_SLOPE - T_INVERSE)
    port map (clk => clk, enable => enable, value => inverse, later => inverse_late);

  start_before_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_SLOPE - 1 - T_ROTATED)
    port map (clk => clk, enable => enable, value => starts(0), later => start_before);

  slopes_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      back         <= -resize(start_before, 33);
      up_slope     <= resize(round_shift(up_product, 30), 31);
      across_slope <= resize(round_shift(across_product, 30), 31);
      -- With p = f / 512 px, the slope is p / s: its derivative is (p' - p / s) / s
      slope_change <= saturate(by_radius - resize(round_shift(z_product, 38), 34), 32);
    end if;
  end process;

  up_line_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 31)
    port map (clk => clk, enable => enable, a => back, b => up_slope, addend => line_addends(0), product => up_line);
  across_line_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 31)
    port map (clk => clk, enable => enable, a => back, b => across_slope, addend => line_addends(1), product => across_line);
  change_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 34)
    port map (clk => clk, enable => enable, a => slope_change, b => inverse_late, product => change_product);
  up_start_g : for i in 0 to 1 generate
    start_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => 1)
      port map (clk => clk, enable => enable, value => starts_late(i + 1), later => line_starts(i));
    -- With half of the last bit, less one: rounds as if the product were rounded and then subtracted
    line_addends(i) <= resize(line_starts(i) & LESS_28, 64);
  end generate;

  lines_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      ray.up               <= saturate(up_line(63 downto 28), 32);
      ray.across           <= saturate(across_line(63 downto 28), 32);
      ray.slope_derivative <= saturate(change_product(65 downto 38), 17);
    end if;
  end process;

  up_slope_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_RAY - T_SLOPE)
    port map (clk => clk, enable => enable, value => up_slope, later => ray.up_slope);
  across_slope_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_RAY - T_SLOPE)
    port map (clk => clk, enable => enable, value => across_slope, later => ray.across_slope);
  -- Over 512 px, and from Q.8 to Q.10
  start_change <= start_derivative(31 downto 7);
  start_derivative_i : entity work.delay
    generic map (G_WIDTH => 25, G_CLOCKS => T_RAY)
    port map (clk => clk, enable => enable, value => start_change, later => ray.start_derivative);
  variance_i : entity work.delay
    generic map (G_WIDTH => 25, G_CLOCKS => T_RAY)
    port map (clk => clk, enable => enable, value => variance, later => ray.variance);
  -- 1 / radius in Q.22, for which the radius is the component along the beam
  inverse_part <= inverse(33 downto 16);
  inverse_radius_i : entity work.delay
    generic map (G_WIDTH => 18, G_CLOCKS => T_RAY - T_INVERSE)
    port map (clk => clk, enable => enable, value => inverse_part, later => ray.inverse_radius);

  exists_line(0) <= sensible;
  exists_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_RAY - T_ROTATED - 1)
    port map (clk => clk, enable => enable, value => exists_line, later => exists_late);
  exists <= exists_late(0);

end architecture;
