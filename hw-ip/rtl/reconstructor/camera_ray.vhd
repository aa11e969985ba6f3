-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Image position to ray in the camera's frame, one per clock.
--
-- Purpose     centre, affine and decentring terms; radius; slope and start of the ray with their derivatives, by Horner
-- Latency     camera_ray_latency(G_TERMS, G_BITS_PER_STAGE) = 15 + ceil(33 / min(G_BITS_PER_STAGE, 2)) + 3 * (G_TERMS - 1)
-- Throughput  one per clock, the cameras in any order. No reset: data only
-- Resources   13 multipliers of 32 bits, two horner with derivative, one root of 64 bits
-- Twin        karst_core::CameraCalibration::ray

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.rounding.all;
use work.reconstructor_pkg.all;

entity camera_ray is
  generic (
    G_TERMS          : positive range 2 to 16;  -- coefficients of each polynomial
    G_BITS_PER_STAGE : positive range 1 to 4    -- of wide divisions; the root has at most 2
  );
  port (
    clk                  : in  std_ulogic;           -- rising edge
    enable               : in  std_ulogic;           -- registers move
    camera_1             : in  words_t(0 to 2 * G_TERMS + CAMERA_POLYNOMIAL - 1);  -- calibration of camera 1, constant
    camera_2             : in  words_t(0 to 2 * G_TERMS + CAMERA_POLYNOMIAL - 1);  -- calibration of camera 2, constant
    camera               : in  std_ulogic;           -- the position's camera: 0 for camera 1
    position_x           : in  signed(31 downto 0);  -- column, px, Q18.14
    position_y           : in  signed(31 downto 0);  -- row, px, Q18.14
    direction_x          : out signed(31 downto 0);  -- px, Q12.20
    direction_y          : out signed(31 downto 0);  -- px, Q12.20
    direction_z          : out signed(31 downto 0);  -- px, Q12.20
    start                : out signed(31 downto 0);  -- on the camera's axis, mm, Q18.14
    direction_derivative : out signed(31 downto 0);  -- of direction_z, by the radius, Q12.20
    start_derivative     : out signed(31 downto 0)   -- of start, by the radius, mm, Q24.8
  );
end entity;

architecture rtl of camera_ray is

  -- Clocks after the position
  constant T_OFFSET : positive := 1;
  constant T_AFFINE : positive := T_OFFSET + 3;
  constant T_TERMS  : positive := T_AFFINE + 3;
  constant T_CENTRE : positive := T_TERMS + 4;
  constant T_SQUARE : positive := T_CENTRE + 3;
  constant T_RADIUS : positive := T_SQUARE + root_latency(32, few(G_BITS_PER_STAGE));
  constant T_RAY    : positive := camera_ray_latency(G_TERMS, G_BITS_PER_STAGE);

  constant CAMERA_AXIAL : positive := CAMERA_POLYNOMIAL + G_TERMS;

  signal camera_at : std_ulogic_vector(0 to T_RAY);

  -- The word of the camera at hand
  function word(of_camera : std_ulogic; word_1, word_2 : signed(31 downto 0)) return signed is
  begin
    if of_camera = '1' then
      return word_2;
    end if;
    return word_1;
  end function;

  subtype word_t    is signed(31 downto 0);
  subtype product_t is signed(63 downto 0);
  type products_t   is array (natural range <>) of product_t;

  signal centre_x, centre_y     : word_t;
  signal offset_x, offset_y     : word_t;
  signal affine                 : words_t(0 to 3);
  signal affine_products        : products_t(0 to 3);
  signal u, v                   : word_t;  -- before decentring
  signal u_u, v_v, u_v          : product_t;
  signal term_x, term_y, term_c : signed(34 downto 0);  -- 3 xx + yy, xx + 3 yy, 2 xy, Q.26
  signal p1, p2                 : word_t;
  signal p1_c, p2_x, p1_y, p2_c : signed(66 downto 0);
  signal shift_x, shift_y       : signed(41 downto 0);
  signal u_late, v_late         : word_t;
  signal x, y                   : word_t;  -- after decentring
  signal x_x, y_y               : product_t;
  signal square                 : std_ulogic_vector(63 downto 0);
  signal root                   : std_ulogic_vector(31 downto 0);
  signal radius                 : std_ulogic_vector(31 downto 0);
  signal polynomial, axial      : std_ulogic_vector(32 * G_TERMS - 1 downto 0);
  signal slope, slope_by_radius : std_ulogic_vector(31 downto 0);
  signal begins, begin_by_radius : std_ulogic_vector(31 downto 0);

begin

  camera_at(0) <= camera;
  camera_at(1 to T_RAY) <= camera_at(0 to T_RAY - 1) when rising_edge(clk) and enable = '1';

  centre_x <= word(camera_at(0), camera_1(CAMERA_CENTRE), camera_2(CAMERA_CENTRE));
  centre_y <= word(camera_at(0), camera_1(CAMERA_CENTRE + 1), camera_2(CAMERA_CENTRE + 1));

  affine_g : for i in 0 to 3 generate
    affine(i) <= word(camera_at(T_OFFSET), camera_1(CAMERA_AFFINE + i), camera_2(CAMERA_AFFINE + i));
  end generate;
  a_x_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => affine(0), b => offset_x, addend => half(24, 64), product => affine_products(0));
  b_y_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => affine(1), b => offset_y, product => affine_products(1));
  c_x_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => affine(2), b => offset_x, addend => half(24, 64), product => affine_products(2));
  d_y_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => affine(3), b => offset_y, product => affine_products(3));

  u_u_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => u, b => u, addend => half(32, 64), product => u_u);
  v_v_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => v, b => v, addend => half(32, 64), product => v_v);
  u_v_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => u, b => v, addend => half(32, 64), product => u_v);

  p1 <= word(camera_at(T_TERMS), camera_1(CAMERA_DECENTRING), camera_2(CAMERA_DECENTRING));
  p2 <= word(camera_at(T_TERMS), camera_1(CAMERA_DECENTRING + 1), camera_2(CAMERA_DECENTRING + 1));
  p1_c_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 35)
    port map (clk => clk, enable => enable, a => p1, b => term_c, addend => half(27, 67), product => p1_c);
  p2_x_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 35)
    port map (clk => clk, enable => enable, a => p2, b => term_x, product => p2_x);
  p1_y_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 35)
    port map (clk => clk, enable => enable, a => p1, b => term_y, addend => half(27, 67), product => p1_y);
  p2_c_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 35)
    port map (clk => clk, enable => enable, a => p2, b => term_c, product => p2_c);

  u_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_CENTRE - 1 - T_AFFINE)
    port map (clk => clk, enable => enable, value => u, later => u_late);
  v_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_CENTRE - 1 - T_AFFINE)
    port map (clk => clk, enable => enable, value => v, later => v_late);

  x_x_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => x, b => x, product => x_x);
  y_y_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => y, b => y, product => y_y);

  sums_p : process (clk)
    variable xx, yy, xy         : signed(31 downto 0);
    variable u_sum, v_sum       : signed(64 downto 0);
    variable x_change, y_change : signed(67 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      offset_x <= saturate(resize(position_x, 33) - centre_x, 32);
      offset_y <= saturate(resize(position_y, 33) - centre_y, 32);

      -- The halves that round come with the products. Q.14 times Q.30, kept at Q.20
      u_sum := resize(affine_products(0), 65) + affine_products(1);
      v_sum := resize(affine_products(2), 65) + affine_products(3);
      u     <= saturate(u_sum(64 downto 24), 32);
      v     <= saturate(v_sum(64 downto 24), 32);

      -- u in Q.20 is x = u / 512 px in Q.29; products are kept at Q.26
      xx     := u_u(63 downto 32);
      yy     := v_v(63 downto 32);
      xy     := u_v(63 downto 32);
      term_x <= resize(xx & '0', 35) + xx + yy;
      term_y <= resize(yy & '0', 35) + yy + xx;
      term_c <= resize(xy & '0', 35);
      -- Q.26 times Q.30 in units of 512 px is Q.47 in px
      x_change := resize(p1_c, 68) + p2_x;
      y_change := resize(p1_y, 68) + p2_c;
      shift_x  <= resize(x_change(67 downto 27), 42);
      shift_y  <= resize(y_change(67 downto 27), 42);
      x        <= saturate(shift_x + u_late, 32);
      y        <= saturate(shift_y + v_late, 32);

      square <= std_ulogic_vector(x_x + y_y);
    end if;
  end process;

  root_i : entity work.sqrt
    generic map (G_WIDTH => 64, G_ROUND => true, G_BITS_PER_STAGE => few(G_BITS_PER_STAGE))
    port map (clk => clk, enable => enable, rst => '0', in_valid => '1', radicand => square, out_valid => open, root => root);

  -- The radius in px Q.20 is s in Q.29
  radius <= root when root(31) = '0' else (31 => '0', others => '1');

  -- A camera's coefficient enters at the clock that horner adds it
  terms_g : for term in 0 to G_TERMS - 1 generate
    constant CLOCKS : natural := T_RADIUS + maximum(3 * (G_TERMS - 2 - term) + 1, 0);
    signal of_polynomial, of_axial : word_t;
  begin
    of_polynomial <= word(camera_at(CLOCKS), camera_1(CAMERA_POLYNOMIAL + term), camera_2(CAMERA_POLYNOMIAL + term));
    of_axial      <= word(camera_at(CLOCKS), camera_1(CAMERA_AXIAL + term), camera_2(CAMERA_AXIAL + term));
    polynomial(32 * term + 31 downto 32 * term) <= std_ulogic_vector(of_polynomial);
    axial(32 * term + 31 downto 32 * term)      <= std_ulogic_vector(of_axial);
  end generate;

  polynomial_i : entity work.horner
    generic map (G_TERMS => G_TERMS, G_DERIVATIVE => true)
    port map (clk => clk, enable => enable, rst => '0', coefficients => polynomial, in_valid => '1', radius => radius,
              out_valid => open, value => slope, derivative => slope_by_radius);
  axial_i : entity work.horner
    generic map (G_TERMS => G_TERMS, G_DERIVATIVE => true)
    port map (clk => clk, enable => enable, rst => '0', coefficients => axial, in_valid => '1', radius => radius,
              out_valid => open, value => begins, derivative => begin_by_radius);

  x_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_RAY - T_CENTRE)
    port map (clk => clk, enable => enable, value => x, later => direction_x);
  y_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_RAY - T_CENTRE)
    port map (clk => clk, enable => enable, value => y, later => direction_y);

  -- Q6.26 in units of 512 px is Q.17 in px; Q6.26 in units of 4096 mm is Q.14 in mm, and Q12.20 is Q.8
  direction_z          <= saturate(signed(slope) & "000", 32);
  direction_derivative <= signed(slope_by_radius);
  start                <= signed(begins);
  start_derivative     <= signed(begin_by_radius);

end architecture;
