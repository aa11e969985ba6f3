-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Weighted least squares of two rays and an uncertain laser beam, one pair per clock.
--
-- Purpose     a crossing becomes a point with its standard deviation and chi squared, or the reason why not. With one
--             camera the second ray is the beam, all zero: its variance then stands for the other camera's
-- Latency     with R = 3 + ceil(17 / G_BITS_PER_STAGE), the latency of a reciprocal: fuse_latency = max(35 + R, 25 + 2 R);
--             the place in the beam's frame 6 less; what the plain average needs fuse_plain_latency = 26 + R
-- Throughput  one per clock. No reset: data only
-- Resources   42 multipliers of up to 33 bits, three reciprocals of 17 bits, one root of 32 bits
-- Twin        karst_core's weighted.rs: stereo, single; fusion.rs: BeamRay, Crossing; calibration.rs: variance_at

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.rounding.all;
use work.reconstructor_pkg.all;

entity fuse is
  generic (
    G_BITS_PER_STAGE : positive range 1 to 4  -- of the divisions on the longest way; the others and the root have at most 2
  );
  port (
    clk                : in  std_ulogic;           -- rising edge
    enable             : in  std_ulogic;           -- registers move
    plain              : in  std_ulogic;           -- do not move the crossing: for the plain average. Constant
    chi2_max           : in  signed(31 downto 0);  -- Q18.14, constant
    -- The pair, clock 0
    single             : in  std_ulogic;           -- the second ray is the beam
    falls              : in  std_ulogic;           -- from crossing
    ray_a              : in  beam_ray_t;           -- first ray
    ray_b              : in  beam_ray_t;           -- second ray; all zero if it is the beam
    -- Clock 1
    inverse            : in  unsigned(31 downto 0);  -- from crossing
    shift              : in  unsigned(3 downto 0);   -- from crossing
    -- Clock 3
    exists             : in  std_ulogic;           -- from crossing, and so
    along              : in  signed(29 downto 0);  -- mm, Q.16
    origin_variance    : in  signed(43 downto 0);  -- of the beam, mm**2, Q.32
    direction_variance : in  signed(33 downto 0);  -- of the beam, rad**2, Q.44
    -- Results, each at its own clock
    plain_along        : out signed(32 downto 0);  -- of the crossing, mm, Q.16
    plain_up           : out signed(32 downto 0);  -- of the crossing, mm, Q.16
    plain_across       : out signed(32 downto 0);  -- middle between the rays, mm, Q.16
    beam_along         : out signed(32 downto 0);  -- of the point, mm, Q.16
    beam_up            : out signed(32 downto 0);  -- of the point, mm, Q.16
    beam_across        : out signed(32 downto 0);  -- of the point, mm, Q.16
    outcome            : out outcome_t;            -- POINT, or why not
    sigma              : out signed(31 downto 0);  -- standard deviation along the beam, mm, Q18.14
    chi2               : out signed(31 downto 0)   -- chi squared, Q18.14
  );
end entity;

architecture rtl of fuse is

  constant FEW_BITS : positive := few(G_BITS_PER_STAGE);
  constant RECIPROCAL : positive := reciprocal_latency(G_BITS_PER_STAGE);

  -- Clocks of what is given
  constant T_INVERSE      : positive := 1;
  constant T_ALONG        : positive := 3;
  -- Clocks of what is made
  constant T_SHARES       : positive := T_INVERSE + 3;
  constant T_SQUARE       : positive := T_ALONG + 2;
  constant T_UP           : positive := T_ALONG + 3;
  constant T_BEAM_VAR     : positive := T_SQUARE + 3;
  constant T_ACROSS_LEVER : positive := T_ALONG + 2;
  constant T_UP_LEVER     : positive := T_ALONG + 3;
  constant T_ACROSS_VAR   : positive := T_ACROSS_LEVER + 5;
  constant T_UP_VAR       : positive := T_UP_LEVER + 5;
  constant T_TOTAL        : positive := T_UP_VAR + 3;
  constant T_WHOLE        : positive := T_ACROSS_VAR + 1;
  constant T_SHARE        : positive := T_WHOLE + RECIPROCAL + 2;
  constant T_ACROSS_TOTAL : positive := T_SHARE + 2;
  constant T_RATIO_ACROSS : positive := T_ACROSS_TOTAL + RECIPROCAL + 2;
  constant T_RATIO_UP     : positive := T_TOTAL + RECIPROCAL + 2;
  constant T_GAIN         : positive := T_TOTAL + RECIPROCAL + 2;
  constant T_MISS         : positive := T_GAIN + 2;
  constant T_CORRECTED    : positive := T_MISS + 4;
  constant T_OFFSETS      : positive := T_CORRECTED + 2;
  constant T_DIFFERENCE   : positive := T_OFFSETS + 1;
  constant T_PLAIN        : positive := T_DIFFERENCE + 1;
  constant T_ACROSS       : positive := T_DIFFERENCE + 2;
  constant T_SCALE        : positive := maximum(T_ACROSS, T_RATIO_ACROSS);
  constant T_BEAM         : positive := T_SCALE + 2;
  constant T_CHI          : positive := T_SCALE + 7;
  constant T_POINT        : positive := T_CHI + 1;
  constant T_REMAINING    : positive := T_MISS + 1;
  constant T_ROOT         : positive := T_REMAINING + 2 + ceil_divide(16, FEW_BITS);
  constant T_SIGMA        : positive := T_ROOT + 4;

  -- 1 as a share of the height of a crossing, Q.14
  constant ONE_SHARE : signed(16 downto 0) := to_signed(2 ** 14, 17);
  -- 1 as a share across, Q.31
  constant WHOLE     : unsigned(31 downto 0) := (31 => '1', others => '0');

  type rays_t     is array (0 to 1) of beam_ray_t;
  type words_17_t is array (0 to 1) of signed(16 downto 0);
  type words_28_t is array (0 to 1) of unsigned(27 downto 0);
  type words_32_t is array (0 to 1) of signed(31 downto 0);
  type words_33_t is array (0 to 1) of signed(32 downto 0);
  type words_34_t is array (0 to 1) of signed(33 downto 0);
  type words_46_t is array (0 to 1) of signed(45 downto 0);
  type words_61_t is array (0 to 1) of signed(60 downto 0);

  signal rays : rays_t;

  signal single_at : std_ulogic_vector(0 to T_POINT);
  signal exists_at : std_ulogic_vector(T_ALONG to T_UP);
  signal falls_at  : std_ulogic_vector(0 to T_MISS + 3);

  -- What the crossing gives, later
  signal inverse_line      : signed(31 downto 0);
  signal inverse_factor    : signed(32 downto 0);
  signal inverse_at_pull   : signed(31 downto 0);
  signal inverse_at_root   : signed(31 downto 0);
  signal pull_factor       : signed(32 downto 0);
  signal root_factor       : signed(32 downto 0);
  signal shift_line        : signed(3 downto 0);
  signal shift_at_shares   : signed(3 downto 0);
  signal shift_at_miss     : signed(3 downto 0);
  signal shift_at_sigma    : signed(3 downto 0);

  -- Up
  signal slope              : signed(30 downto 0);  -- the first ray's, turned if the difference of the slopes is negative
  signal share_product      : signed(63 downto 0);
  signal share_wide         : signed(23 downto 0);  -- Q.14
  signal shares             : words_17_t;  -- b1 and b2, Q.14
  signal share_fits         : std_ulogic_vector(T_SHARES + 1 to T_UP);
  signal share_squares      : words_34_t;
  signal share_squares_late : words_32_t;
  signal shares_late        : words_17_t;
  signal up_slope           : signed(30 downto 0);
  signal up_at_product      : signed(27 downto 0);
  signal up_addend          : signed(60 downto 0);
  signal up_product         : signed(60 downto 0);
  signal up_last_line       : signed(0 downto 0);
  signal up_last_bit        : signed(0 downto 0);
  signal up                 : signed(32 downto 0);  -- Q.16
  signal up_variances       : words_28_t;  -- Q.20
  signal variance_products  : words_61_t;
  signal covariance_products : words_46_t;
  signal up_total           : unsigned(31 downto 0);
  signal covariance         : signed(31 downto 0);
  signal covariance_size    : unsigned(29 downto 0);
  signal covariance_line    : signed(30 downto 0);
  signal covariance_at_gain  : signed(30 downto 0);
  signal covariance_at_shift : signed(30 downto 0);
  signal covariance_falls    : signed(0 downto 0);
  signal covariance_falls_late : signed(0 downto 0);
  signal up_total_late      : unsigned(31 downto 0);
  signal up_total_shift     : unsigned(4 downto 0);
  signal up_total_shift_line : signed(4 downto 0);
  signal up_total_shift_late : signed(4 downto 0);
  signal up_total_inverse   : unsigned(31 downto 0);
  signal up_inverse_factor  : signed(17 downto 0);
  signal gain_shifted       : signed(32 downto 0);
  signal gain_limit         : signed(0 downto 0);
  signal gain_limit_late    : signed(0 downto 0);
  signal gain_product       : signed(50 downto 0);
  signal gain               : signed(31 downto 0);  -- magnitude, Q.27

  -- Beam
  signal distance         : signed(15 downto 0);  -- Q.2
  signal square           : signed(31 downto 0);
  signal origin_line      : signed(31 downto 0);
  signal origin_late      : signed(31 downto 0);
  signal direction_line   : signed(31 downto 0);
  signal direction_late   : signed(31 downto 0);
  signal beam_addend      : signed(63 downto 0);
  signal beam_product     : signed(63 downto 0);
  signal beam_variance    : signed(31 downto 0);  -- Q.20
  signal beam_at_up_var   : signed(31 downto 0);
  signal beam_at_up_sum   : signed(31 downto 0);
  signal beam_at_ratio    : signed(31 downto 0);
  signal beam_at_mean     : signed(31 downto 0);
  signal beam_at_across   : signed(31 downto 0);

  -- Along
  signal up_near          : signed(26 downto 0);  -- up, if it is not inconsistent
  signal up_late          : signed(26 downto 0);
  signal up_size          : signed(26 downto 0);
  signal up_at_ratio      : signed(26 downto 0);
  signal up_at_chi        : signed(26 downto 0);
  signal up_falls         : signed(0 downto 0);
  signal up_falls_late    : signed(0 downto 0);
  signal miss_product     : signed(58 downto 0);
  signal miss             : unsigned(31 downto 0);  -- Q.16
  signal miss_shifted     : signed(32 downto 0);
  signal beyond           : std_ulogic_vector(T_MISS + 1 to T_CORRECTED);
  signal pull_product     : signed(65 downto 0);
  signal along_late       : signed(29 downto 0);
  signal corrected        : signed(32 downto 0);
  signal variance_sum      : signed(32 downto 0);
  signal variance_sum_late : signed(32 downto 0);
  signal explained        : signed(62 downto 0);
  signal along_variance   : unsigned(31 downto 0);
  signal radicand         : unsigned(31 downto 0);
  signal zeros            : unsigned(4 downto 0);
  signal zeros_line       : signed(4 downto 0);
  signal zeros_late       : signed(4 downto 0);
  signal no_variance      : signed(0 downto 0);
  signal no_variance_late : signed(0 downto 0);
  signal radicand_even    : std_ulogic_vector(31 downto 0);
  signal root             : std_ulogic_vector(15 downto 0);
  signal root_signed      : signed(16 downto 0);
  signal sigma_product    : signed(49 downto 0);
  signal sigma_fine       : signed(32 downto 0);
  signal sigma_here       : signed(31 downto 0);

  -- Across
  signal across_variances : words_28_t;  -- Q.20
  signal whole_variance   : unsigned(31 downto 0);
  signal whole_shift      : unsigned(4 downto 0);
  signal whole_shift_line : signed(4 downto 0);
  signal whole_shift_at_ratio : signed(4 downto 0);
  signal whole_shift_late : signed(4 downto 0);
  signal whole_inverse    : unsigned(31 downto 0);
  signal whole_inverse_line : signed(16 downto 0);
  signal whole_inverse_late : signed(16 downto 0);
  signal whole_inverse_chi  : unsigned(31 downto 0);
  signal second_line      : signed(27 downto 0);
  signal second_late      : signed(27 downto 0);
  signal second_part      : unsigned(31 downto 0);
  signal share_ratio      : unsigned(31 downto 0);
  signal across_share     : unsigned(31 downto 0);  -- of the first ray, Q.31
  signal share_factor     : signed(32 downto 0);
  signal share_late       : signed(32 downto 0);
  signal first_line       : signed(30 downto 0);
  signal first_late       : signed(30 downto 0);
  signal mean_addend      : signed(63 downto 0);
  signal mean_product     : signed(63 downto 0);
  signal across_total     : unsigned(31 downto 0);
  signal across_total_shift : unsigned(4 downto 0);
  signal across_total_shift_line : signed(4 downto 0);
  signal across_total_shift_at_ratio : signed(4 downto 0);
  signal across_total_shift_late : signed(4 downto 0);
  signal across_total_inverse : unsigned(31 downto 0);
  signal across_inverse_line : signed(16 downto 0);
  signal across_inverse_late : signed(16 downto 0);
  signal across_inverse_chi  : unsigned(31 downto 0);
  signal offset_addends   : words_61_t;
  signal offset_products  : words_61_t;
  signal offsets          : words_33_t;  -- Q.16
  signal second_offset    : signed(32 downto 0);
  signal second_offset_near : signed(26 downto 0);
  signal second_offset_late : signed(26 downto 0);
  signal difference       : signed(26 downto 0);
  signal sum              : signed(33 downto 0);
  signal shift_addend     : signed(59 downto 0);
  signal shift_product    : signed(59 downto 0);
  signal across           : signed(26 downto 0);
  signal across_late      : signed(26 downto 0);

  -- Point
  signal up_ratio_part     : unsigned(31 downto 0);
  signal up_ratio_shift    : unsigned(4 downto 0);
  signal ratio_up          : unsigned(31 downto 0);
  signal ratio_up_factor   : signed(32 downto 0);
  signal across_ratio_part : unsigned(31 downto 0);
  signal across_ratio_shift : unsigned(4 downto 0);
  signal share_ratio_shift : unsigned(4 downto 0);
  signal ratio_across      : unsigned(31 downto 0);
  signal ratio_across_factor : signed(32 downto 0);
  signal ratio_across_late : signed(32 downto 0);
  signal up_scaled         : signed(59 downto 0);
  signal across_scaled     : signed(59 downto 0);
  signal beam_up_here      : signed(32 downto 0);
  signal corrected_fit     : signed(32 downto 0);

  -- chi squared, Q.12
  signal chi2_up              : unsigned(29 downto 0);
  signal chi2_difference      : unsigned(29 downto 0);
  signal chi2_across          : unsigned(29 downto 0);
  signal chi2_up_signed       : signed(30 downto 0);
  signal chi2_up_late         : signed(30 downto 0);
  signal chi2_difference_signed : signed(30 downto 0);
  signal chi2_difference_late : signed(30 downto 0);
  signal most                 : signed(33 downto 0);  -- that all three terms may be
  signal most_of_one          : signed(33 downto 0);
  signal chi2_of_two          : signed(32 downto 0);
  signal chi2_of_two_late     : signed(32 downto 0);
  signal whole_chi_shift      : unsigned(4 downto 0);
  signal across_chi_shift     : unsigned(4 downto 0);

  -- What is known of the outcome
  signal outcome_crossing     : outcome_t;
  signal outcome_late         : signed(2 downto 0);
  signal outcome_reach        : outcome_t;
  signal outcome_reach_late   : signed(2 downto 0);
  signal outcome_offsets      : outcome_t;
  signal outcome_offsets_late : signed(2 downto 0);

begin

  rays <= (ray_a, ray_b);

  single_at(0)             <= single;
  falls_at(0)              <= falls;
  exists_at(T_ALONG)       <= exists;
  single_at(1 to T_POINT)  <= single_at(0 to T_POINT - 1) when rising_edge(clk) and enable = '1';
  falls_at(1 to T_MISS + 3) <= falls_at(0 to T_MISS + 2) when rising_edge(clk) and enable = '1';
  exists_at(T_ALONG + 1 to T_UP) <= exists_at(T_ALONG to T_UP - 1) when rising_edge(clk) and enable = '1';

  inverse_line   <= signed(inverse);
  inverse_factor <= signed('0' & inverse);
  inverse_at_pull_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_MISS + 1 - T_INVERSE)
    port map (clk => clk, enable => enable, value => inverse_line, later => inverse_at_pull);
  inverse_at_root_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_ROOT - T_MISS - 1)
    port map (clk => clk, enable => enable, value => inverse_at_pull, later => inverse_at_root);
  pull_factor <= '0' & inverse_at_pull;
  root_factor <= '0' & inverse_at_root;
  shift_line  <= signed(shift);
  shift_at_shares_i : entity work.delay
    generic map (G_WIDTH => 4, G_CLOCKS => T_SHARES - 1 - T_INVERSE)
    port map (clk => clk, enable => enable, value => shift_line, later => shift_at_shares);
  shift_at_miss_i : entity work.delay
    generic map (G_WIDTH => 4, G_CLOCKS => T_MISS - T_SHARES + 1)
    port map (clk => clk, enable => enable, value => shift_at_shares, later => shift_at_miss);
  shift_at_sigma_i : entity work.delay
    generic map (G_WIDTH => 4, G_CLOCKS => T_ROOT + 2 - T_MISS)
    port map (clk => clk, enable => enable, value => shift_at_miss, later => shift_at_sigma);

  -- The beam's variance at this distance; of the distance a quarter of a millimetre is enough, here and for the rays'

  distance <= '0' & along(28 downto 14);
  square_i : entity work.multiply
    generic map (G_A_WIDTH => 16, G_B_WIDTH => 16)
    port map (clk => clk, enable => enable, a => distance, b => distance, product => square);
  direction_line <= direction_variance(33 downto 2);
  direction_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_SQUARE - T_ALONG)
    port map (clk => clk, enable => enable, value => direction_line, later => direction_late);
  origin_line <= origin_variance(43 downto 12);
  origin_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_SQUARE + 1 - T_ALONG)
    port map (clk => clk, enable => enable, value => origin_line, later => origin_late);
  beam_addend <= shift_left(resize(origin_late, 64), 26);
  beam_variance_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => square, b => direction_late, addend => beam_addend, product => beam_product);
  beam_variance <= saturate(beam_product(63 downto 26), 32) when rising_edge(clk) and enable = '1';
  beam_at_up_var_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_UP_VAR - T_BEAM_VAR)
    port map (clk => clk, enable => enable, value => beam_variance, later => beam_at_up_var);
  beam_at_up_sum_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => 2)
    port map (clk => clk, enable => enable, value => beam_at_up_var, later => beam_at_up_sum);
  beam_at_mean_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_SHARE + 1 - T_UP_VAR - 2)
    port map (clk => clk, enable => enable, value => beam_at_up_sum, later => beam_at_mean);
  beam_at_ratio_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_RATIO_UP - 3 - T_UP_VAR - 2)
    port map (clk => clk, enable => enable, value => beam_at_up_sum, later => beam_at_ratio);
  beam_at_across_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_RATIO_ACROSS - 3 - T_SHARE - 1)
    port map (clk => clk, enable => enable, value => beam_at_mean, later => beam_at_across);

  -- Both rays' variances

  rays_g : for i in 0 to 1 generate
    signal slope_derivative : signed(16 downto 0);
    signal start_derivative : signed(24 downto 0);
    signal inverse_radius   : signed(17 downto 0);
    signal lever_product    : signed(32 downto 0);
    signal up_lever         : signed(26 downto 0);
    signal across_product   : signed(33 downto 0);
    signal across_lever     : signed(26 downto 0);
    signal variance_across  : signed(24 downto 0);
    signal variance_up      : signed(24 downto 0);
    signal variance_factor  : signed(28 downto 0);
    signal across_slope     : signed(30 downto 0);
    signal across_start     : signed(27 downto 0);
    signal across_last_bit  : signed(0 downto 0);
    signal across_last_line : signed(0 downto 0);
  begin

    slope_derivative_i : entity work.delay
      generic map (G_WIDTH => 17, G_CLOCKS => T_ALONG)
      port map (clk => clk, enable => enable, value => rays(i).slope_derivative, later => slope_derivative);
    start_derivative_i : entity work.delay
      generic map (G_WIDTH => 25, G_CLOCKS => T_UP_LEVER - 1)
      port map (clk => clk, enable => enable, value => rays(i).start_derivative, later => start_derivative);
    inverse_radius_i : entity work.delay
      generic map (G_WIDTH => 18, G_CLOCKS => T_ALONG)
      port map (clk => clk, enable => enable, value => rays(i).inverse_radius, later => inverse_radius);
    variance_across_i : entity work.delay
      generic map (G_WIDTH => 25, G_CLOCKS => T_ACROSS_LEVER + 3)
      port map (clk => clk, enable => enable, value => rays(i).variance, later => variance_across);
    variance_up_i : entity work.delay
      generic map (G_WIDTH => 25, G_CLOCKS => T_UP_LEVER - T_ACROSS_LEVER)
      port map (clk => clk, enable => enable, value => variance_across, later => variance_up);

    -- mm per px: the slope's share grows with the distance, the start's does not
    lever_i : entity work.multiply
      generic map (G_A_WIDTH => 17, G_B_WIDTH => 16)
      port map (clk => clk, enable => enable, a => slope_derivative, b => distance, product => lever_product);
    up_lever <= resize(lever_product(32 downto 12), 27) + start_derivative when rising_edge(clk) and enable = '1';
    up_variance_i : entity work.spread
      port map (clk => clk, enable => enable, lever => up_lever, variance => variance_up, result => up_variances(i));

    radius_i : entity work.multiply
      generic map (G_A_WIDTH => 18, G_B_WIDTH => 16)
      port map (clk => clk, enable => enable, a => inverse_radius, b => distance, product => across_product);
    across_lever <= resize(across_product(33 downto 14), 27);
    across_variance_i : entity work.spread
      port map (clk => clk, enable => enable, lever => across_lever, variance => variance_across,
                result => across_variances(i));

    -- With the other ray's variance
    variance_factor <= signed('0' & up_variances(1 - i));
    share_square_i : entity work.multiply
      generic map (G_A_WIDTH => 17, G_B_WIDTH => 17)
      port map (clk => clk, enable => enable, a => shares(i), b => shares(i), product => share_squares(i));
    share_square_late_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => T_UP_VAR - T_SHARES - 3)
      port map (clk => clk, enable => enable, value => share_squares(i)(31 downto 0), later => share_squares_late(i));
    share_at_variance_i : entity work.delay
      generic map (G_WIDTH => 17, G_CLOCKS => T_UP_VAR - T_SHARES - 1)
      port map (clk => clk, enable => enable, value => shares(i), later => shares_late(i));
    variance_product_i : entity work.multiply
      generic map (G_A_WIDTH => 32, G_B_WIDTH => 29)
      port map (clk => clk, enable => enable, a => share_squares_late(i), b => variance_factor,
                product => variance_products(i));
    covariance_product_i : entity work.multiply
      generic map (G_A_WIDTH => 17, G_B_WIDTH => 29)
      port map (clk => clk, enable => enable, a => shares_late(i), b => variance_factor,
                product => covariance_products(i));

    -- Twice the product keeps the last bit of the start
    across_slope_i : entity work.delay
      generic map (G_WIDTH => 31, G_CLOCKS => T_CORRECTED)
      port map (clk => clk, enable => enable, value => rays(i).across_slope, later => across_slope);
    across_start_i : entity work.delay
      generic map (G_WIDTH => 28, G_CLOCKS => T_CORRECTED + 1)
      port map (clk => clk, enable => enable, value => rays(i).across, later => across_start);
    across_last_line(0) <= across_start(0);
    across_last_bit_i : entity work.delay
      generic map (G_WIDTH => 1, G_CLOCKS => 1)
      port map (clk => clk, enable => enable, value => across_last_line, later => across_last_bit);
    offset_addends(i) <= shift_left(resize(across_start(27 downto 1), 61), 29);
    offset_i : entity work.multiply
      generic map (G_A_WIDTH => 31, G_B_WIDTH => 30)
      port map (clk => clk, enable => enable, a => across_slope, b => corrected(29 downto 0), addend => offset_addends(i),
                product => offset_products(i));
    offsets(i)          <= offset_products(i)(60 downto 29) & across_last_bit;

  end generate;

  share_i : entity work.multiply
    generic map (G_A_WIDTH => 31, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => slope, b => inverse_factor, product => share_product);

  up_addend <= shift_left(resize(up_at_product(27 downto 1), 61), 29);
  up_start_i : entity work.delay
    generic map (G_WIDTH => 28, G_CLOCKS => T_ALONG + 1)
    port map (clk => clk, enable => enable, value => rays(0).up, later => up_at_product);
  up_slope_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_ALONG)
    port map (clk => clk, enable => enable, value => rays(0).up_slope, later => up_slope);
  up_product_i : entity work.multiply
    generic map (G_A_WIDTH => 31, G_B_WIDTH => 30)
    port map (clk => clk, enable => enable, a => up_slope, b => along, addend => up_addend, product => up_product);

  variances_p : process (clk)
    variable cross      : signed(31 downto 0);
    variable share_left : signed(31 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      slope      <= -rays(0).up_slope when falls = '1' else rays(0).up_slope;
      -- To the left, and 8 bits less: GHDL 2.0 makes a logical shift of a signed one to the right
      share_left := shift_left(resize(share_product(63 downto 40), 32), to_integer(unsigned(shift_at_shares) - 1));
      share_wide <= share_left(31 downto 8);
      shares(0)  <= resize(share_wide, 17);
      shares(1)  <= ONE_SHARE - resize(share_wide, 17);

      up <= (others => '0') when single_at(T_UP - 1) = '1' else resize(up_product(60 downto 29) & up_last_bit, 33);

      up_total <= unsigned(beam_at_up_sum) + unsigned(variance_products(0)(59 downto 28))
                  + unsigned(variance_products(1)(59 downto 28));
      cross      := covariance_products(0)(45 downto 14) - covariance_products(1)(45 downto 14);
      covariance <= (others => '0') when plain = '1' or single_at(T_TOTAL - 1) = '1' else cross;
      variance_sum <= signed(resize(up_variances(0), 33)) + beam_at_up_var when single_at(T_UP_VAR) = '1' else
                      signed(resize(up_variances(0), 33)) + signed(resize(up_variances(1), 33));

      whole_variance <= resize(across_variances(0), 32) + across_variances(1);
    end if;
  end process;

  up_last_line(0) <= up_at_product(0);
  up_last_bit_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => 1)
    port map (clk => clk, enable => enable, value => up_last_line, later => up_last_bit);

  shares_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      share_fits <= '0' & share_fits(T_SHARES + 1 to T_UP - 1);
      if share_wide > -2 ** 14 and share_wide < 2 ** 15 then
        share_fits(T_SHARES + 1) <= '1';
      end if;

      if exists_at(T_UP) = '0' or share_fits(T_UP) = '0' then
        outcome_crossing <= NO_INTERSECTION;
      elsif not within(up, 25) then
        outcome_crossing <= INCONSISTENT;
      else
        outcome_crossing <= POINT;
      end if;
    end if;
  end process;

  up_near <= resize(up, 27);
  up_at_chi_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_GAIN - 4 - T_UP)
    port map (clk => clk, enable => enable, value => up_near, later => up_at_chi);
  up_late_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => 3)
    port map (clk => clk, enable => enable, value => up_at_chi, later => up_late);
  up_at_ratio <= up_late when rising_edge(clk) and enable = '1';

  -- The beam pulls the crossing

  up_total_i : entity work.reciprocal
    generic map (G_EXACT => false, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, value => up_total, shift => up_total_shift, inverse => up_total_inverse);
  up_total_shift_line <= signed(up_total_shift);
  up_total_shift_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => RECIPROCAL - 3)
    port map (clk => clk, enable => enable, value => up_total_shift_line, later => up_total_shift_late);
  up_ratio_shift    <= unsigned(up_total_shift_late);
  up_inverse_factor <= signed('0' & up_total_inverse(31 downto 15));
  covariance_line   <= signed('0' & covariance_size);
  covariance_at_shift_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => RECIPROCAL - 2)
    port map (clk => clk, enable => enable, value => covariance_line, later => covariance_at_shift);
  covariance_at_gain_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => 3)
    port map (clk => clk, enable => enable, value => covariance_at_shift, later => covariance_at_gain);
  gain_product_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 18)
    port map (clk => clk, enable => enable, a => gain_shifted, b => up_inverse_factor, product => gain_product);
  gain_limit_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => RECIPROCAL)
    port map (clk => clk, enable => enable, value => gain_limit, later => gain_limit_late);
  gain <= (31 => '0', others => '1') when gain_limit_late(0) = '1' else gain_product(48 downto 17);
  miss_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 32)
    port map (clk => clk, enable => enable, a => up_size, b => gain, product => miss_product);
  miss <= unsigned(miss_product(58 downto 27));
  pull_i : entity work.multiply
    generic map (G_A_WIDTH => 33, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => miss_shifted, b => pull_factor, product => pull_product);
  along_late_i : entity work.delay
    generic map (G_WIDTH => 30, G_CLOCKS => T_CORRECTED - 1 - T_ALONG)
    port map (clk => clk, enable => enable, value => along, later => along_late);
  covariance_falls_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_CORRECTED - 2 - T_TOTAL)
    port map (clk => clk, enable => enable, value => covariance_falls, later => covariance_falls_late);
  up_falls_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_CORRECTED - 1 - T_GAIN)
    port map (clk => clk, enable => enable, value => up_falls, later => up_falls_late);
  outcome_crossing_i : entity work.delay
    generic map (G_WIDTH => 3, G_CLOCKS => T_CORRECTED - T_UP - 1)
    port map (clk => clk, enable => enable, value => signed(outcome_crossing), later => outcome_late);

  correct_p : process (clk)
    variable size    : unsigned(31 downto 0);
    variable shifted : unsigned(35 downto 0);
    variable wide    : unsigned(40 downto 0);
    variable pull    : signed(32 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      size := unsigned(covariance);
      if covariance(31) = '1' then
        size := unsigned(-covariance);
      end if;
      covariance_size     <= size(29 downto 0);
      covariance_falls(0) <= covariance(31);
      up_total_late       <= up_total;

      -- In Q.27 it is limited to 16
      gain_limit(0) <= '1' when plain = '0' and resize(covariance_size(29 downto 4), 32) >= up_total_late else '0';
      shifted       := shift_left(resize(unsigned(covariance_at_shift), 36), to_integer(up_ratio_shift));
      gain_shifted  <= signed('0' & shifted(35 downto 4));

      up_size     <= -up_late when up_late(26) = '1' else up_late;
      up_falls(0) <= up_late(26);

      -- Below 2 ** 32 if the pull is not out of range
      wide         := shift_left(resize(miss, 41), to_integer(unsigned(shift_at_miss) - 1));
      miss_shifted <= signed('0' & wide(31 downto 0));
      beyond       <= (or wide(40 downto 32)) & beyond(T_MISS + 1 to T_CORRECTED - 1);

      pull := resize(pull_product(65 downto 34), 33);
      if (up_falls_late(0) xor covariance_falls_late(0) xor falls_at(T_MISS + 3)) = '1' then
        corrected <= along_late + pull;
      else
        corrected <= along_late - pull;
      end if;

      outcome_reach <= unsigned(outcome_late);
      if unsigned(outcome_late) = POINT and (beyond(T_CORRECTED) = '1' or not in_reach(corrected)) then
        outcome_reach <= OUT_OF_RANGE;
      end if;
    end if;
  end process;

  -- Standard deviation along the beam

  variance_sum_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_MISS - T_UP_VAR - 1)
    port map (clk => clk, enable => enable, value => variance_sum, later => variance_sum_late);
  explained_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 31)
    port map (clk => clk, enable => enable, a => gain, b => covariance_at_gain, product => explained);
  radicand_i : entity work.normalise
    port map (clk => clk, enable => enable, value => along_variance, normalised => radicand, shift => zeros);
  zeros_line    <= signed(zeros);
  zeros_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => T_ROOT - T_REMAINING)
    port map (clk => clk, enable => enable, value => zeros_line, later => zeros_late);
  no_variance(0) <= nor along_variance;
  no_variance_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_ROOT + 2 - T_REMAINING)
    port map (clk => clk, enable => enable, value => no_variance, later => no_variance_late);
  -- An even shift leaves the lowest bit of an odd number of zeros clear
  radicand_even <= std_ulogic_vector(shift_right(radicand, 1)) when zeros(0) = '1' else std_ulogic_vector(radicand);
  root_i : entity work.sqrt
    generic map (G_WIDTH => 32, G_ROUND => false, G_BITS_PER_STAGE => FEW_BITS)
    port map (clk => clk, enable => enable, rst => '0', in_valid => '1', radicand => radicand_even, out_valid => open,
              root => root);
  root_signed <= signed('0' & root);
  sigma_i : entity work.multiply
    generic map (G_A_WIDTH => 17, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => root_signed, b => root_factor, product => sigma_product);

  sigma_p : process (clk)
    variable rest  : signed(32 downto 0);
    variable right : unsigned(4 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      rest           := variance_sum_late - signed('0' & explained(58 downto 27));
      along_variance <= (others => '0') when rest(32) = '1' else unsigned(rest(31 downto 0));

      right      := resize(unsigned(zeros_late(4 downto 1)), 5) + 13 - unsigned('0' & shift_at_sigma);
      sigma_fine <= signed('0' & shift_right(unsigned(sigma_product(47 downto 16)), to_integer(right)));
      if no_variance_late(0) = '1' then
        sigma_fine <= (others => '0');
      end if;
      sigma_here <= resize(round_shift(sigma_fine, 2), 32);
    end if;
  end process;

  sigma_late_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_POINT - T_SIGMA)
    port map (clk => clk, enable => enable, value => sigma_here, later => sigma);

  -- Across: mean of the rays by their variances

  whole_i : entity work.reciprocal
    generic map (G_EXACT => false, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, value => whole_variance, shift => whole_shift, inverse => whole_inverse);
  whole_shift_line <= signed(whole_shift);
  whole_shift_at_ratio_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => RECIPROCAL - 3)
    port map (clk => clk, enable => enable, value => whole_shift_line, later => whole_shift_at_ratio);
  whole_shift_late_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => T_DIFFERENCE + 1 - (T_SHARE - 3))
    port map (clk => clk, enable => enable, value => whole_shift_at_ratio, later => whole_shift_late);
  whole_inverse_line <= signed(whole_inverse(31 downto 15));
  whole_inverse_i : entity work.delay
    generic map (G_WIDTH => 17, G_CLOCKS => T_DIFFERENCE + 2 - (T_SHARE - 2))
    port map (clk => clk, enable => enable, value => whole_inverse_line, later => whole_inverse_late);
  second_line <= signed(across_variances(1));
  second_variance_i : entity work.delay
    generic map (G_WIDTH => 28, G_CLOCKS => T_SHARE - 3 - T_ACROSS_VAR)
    port map (clk => clk, enable => enable, value => second_line, later => second_late);
  second_part       <= resize(unsigned(second_late), 32);
  share_ratio_shift <= unsigned(whole_shift_at_ratio);
  ratio_share_i : entity work.ratio
    port map (clk => clk, enable => enable, part => second_part, shift => share_ratio_shift, inverse => whole_inverse,
              share => share_ratio);
  across_share <= WHOLE when single_at(T_SHARE) = '1' else share_ratio;
  share_factor <= signed('0' & across_share);
  first_line   <= signed(resize(across_variances(0), 31));
  first_variance_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_SHARE - T_ACROSS_VAR)
    port map (clk => clk, enable => enable, value => first_line, later => first_late);
  mean_addend <= shift_left(resize(beam_at_mean, 64), 31);
  mean_i : entity work.multiply
    generic map (G_A_WIDTH => 31, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => first_late, b => share_factor, addend => mean_addend,
              product => mean_product);
  across_total <= unsigned(mean_product(62 downto 31));
  share_late_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_DIFFERENCE - T_SHARE)
    port map (clk => clk, enable => enable, value => share_factor, later => share_late);
  second_offset      <= offsets(0) when single_at(T_OFFSETS) = '1' else offsets(1);
  second_offset_near <= second_offset(26 downto 0);
  second_offset_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_ACROSS - 1 - T_OFFSETS)
    port map (clk => clk, enable => enable, value => second_offset_near, later => second_offset_late);
  shift_addend <= shift_left(resize(second_offset_late, 60), 31);
  shift_product_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => difference, b => share_late, addend => shift_addend,
              product => shift_product);
  across <= shift_product(57 downto 31);
  across_late_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_SCALE - T_ACROSS)
    port map (clk => clk, enable => enable, value => across, later => across_late);
  outcome_reach_i : entity work.delay
    generic map (G_WIDTH => 3, G_CLOCKS => T_OFFSETS - T_CORRECTED - 1)
    port map (clk => clk, enable => enable, value => signed(outcome_reach), later => outcome_reach_late);

  across_p : process (clk)
    variable near : boolean;
  begin
    if rising_edge(clk) and enable = '1' then
      difference <= resize(offsets(0) - second_offset, 27);
      sum        <= resize(offsets(0), 34) + second_offset;
      if single_at(T_OFFSETS) = '1' then
        near := within(offsets(0), 25);
      else
        near := within(offsets(0), 24) and within(offsets(1), 24);
      end if;
      outcome_offsets <= unsigned(outcome_reach_late);
      if unsigned(outcome_reach_late) = POINT and not near then
        outcome_offsets <= INCONSISTENT;
      end if;
    end if;
  end process;

  -- The beam pulls up and across

  up_ratio_part <= unsigned(beam_at_ratio);
  ratio_up_i : entity work.ratio
    port map (clk => clk, enable => enable, part => up_ratio_part, shift => up_ratio_shift, inverse => up_total_inverse,
              share => ratio_up);
  ratio_up_factor <= signed('0' & ratio_up);
  up_scaled_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => up_at_ratio, b => ratio_up_factor, product => up_scaled);
  beam_up_here <= resize(up_scaled(59 downto 31), 33);
  beam_up_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_BEAM - T_RATIO_UP - 2)
    port map (clk => clk, enable => enable, value => beam_up_here, later => beam_up);

  across_total_i : entity work.reciprocal
    generic map (G_EXACT => false, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, value => across_total, shift => across_total_shift,
              inverse => across_total_inverse);
  across_total_shift_line <= signed(across_total_shift);
  across_shift_at_ratio_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => RECIPROCAL - 3)
    port map (clk => clk, enable => enable, value => across_total_shift_line, later => across_total_shift_at_ratio);
  across_shift_late_i : entity work.delay
    generic map (G_WIDTH => 5, G_CLOCKS => T_SCALE + 1 - (T_RATIO_ACROSS - 3))
    port map (clk => clk, enable => enable, value => across_total_shift_at_ratio, later => across_total_shift_late);
  across_inverse_line <= signed(across_total_inverse(31 downto 15));
  across_inverse_i : entity work.delay
    generic map (G_WIDTH => 17, G_CLOCKS => T_SCALE + 2 - (T_RATIO_ACROSS - 2))
    port map (clk => clk, enable => enable, value => across_inverse_line, later => across_inverse_late);
  across_ratio_part  <= unsigned(beam_at_across);
  across_ratio_shift <= unsigned(across_total_shift_at_ratio);
  ratio_across_i : entity work.ratio
    port map (clk => clk, enable => enable, part => across_ratio_part, shift => across_ratio_shift,
              inverse => across_total_inverse, share => ratio_across);
  ratio_across_factor <= signed('0' & ratio_across);
  ratio_across_late_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_SCALE - T_RATIO_ACROSS)
    port map (clk => clk, enable => enable, value => ratio_across_factor, later => ratio_across_late);
  across_scaled_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 33)
    port map (clk => clk, enable => enable, a => across_late, b => ratio_across_late, product => across_scaled);
  beam_across <= resize(across_scaled(59 downto 31), 33);

  corrected_fit <= corrected;
  plain_along_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_PLAIN - T_CORRECTED)
    port map (clk => clk, enable => enable, value => corrected_fit, later => plain_along);
  beam_along_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_BEAM - T_CORRECTED)
    port map (clk => clk, enable => enable, value => corrected_fit, later => beam_along);
  plain_up_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_PLAIN - T_UP)
    port map (clk => clk, enable => enable, value => up, later => plain_up);
  plain_across <= resize(round_shift(sum, 1), 33) when rising_edge(clk) and enable = '1';

  -- chi squared: three terms, each a square over its variance

  chi2_up_i : entity work.chi_square
    port map (clk => clk, enable => enable, offset => up_at_chi, shift => up_ratio_shift, inverse => up_total_inverse,
              chi2 => chi2_up);
  whole_chi_shift   <= unsigned(whole_shift_late);
  whole_inverse_chi <= unsigned(whole_inverse_late) & to_unsigned(0, 15);
  chi2_difference_i : entity work.chi_square
    port map (clk => clk, enable => enable, offset => difference, shift => whole_chi_shift, inverse => whole_inverse_chi,
              chi2 => chi2_difference);
  across_chi_shift   <= unsigned(across_total_shift_late);
  across_inverse_chi <= unsigned(across_inverse_late) & to_unsigned(0, 15);
  chi2_across_i : entity work.chi_square
    port map (clk => clk, enable => enable, offset => across_late, shift => across_chi_shift, inverse => across_inverse_chi,
              chi2 => chi2_across);
  chi2_up_signed <= signed('0' & chi2_up);
  chi2_up_late_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_CHI - 2 - (T_GAIN + 3))
    port map (clk => clk, enable => enable, value => chi2_up_signed, later => chi2_up_late);
  chi2_difference_signed <= signed('0' & chi2_difference);
  chi2_difference_late_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_CHI - 2 - (T_DIFFERENCE + 7))
    port map (clk => clk, enable => enable, value => chi2_difference_signed, later => chi2_difference_late);
  outcome_offsets_i : entity work.delay
    generic map (G_WIDTH => 3, G_CLOCKS => T_CHI - T_DIFFERENCE)
    port map (clk => clk, enable => enable, value => signed(outcome_offsets), later => outcome_offsets_late);

  point_p : process (clk)
    variable terms : signed(32 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      -- In Q.12, rounded down. The largest chi2_max allows any chi2: the sum saturates there
      most <= resize(chi2_max(31 downto 2), 34);
      if chi2_max = to_signed(2 ** 30 - 1, 32) + 2 ** 30 then
        most <= (33 => '0', others => '1');
      end if;

      chi2_of_two      <= resize(chi2_up_late, 33) + chi2_difference_late;
      chi2_of_two_late <= chi2_of_two;
      most_of_one      <= most - chi2_of_two;

      -- A term at the end of its 30 bits makes the sum, in Q.14, saturate
      terms := chi2_of_two_late + signed('0' & chi2_across);
      chi2  <= saturate(terms & "00", 32);

      outcome <= unsigned(outcome_offsets_late);
      if unsigned(outcome_offsets_late) = POINT and signed('0' & chi2_across) > most_of_one then
        outcome <= INCONSISTENT;
      end if;
    end if;
  end process;

end architecture;
