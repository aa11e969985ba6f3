-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Weighted least squares of two rays and an uncertain laser beam, one pair per clock.
--
-- Purpose     a crossing becomes a point with its standard deviation and chi squared, or the reason why not. With one
--             camera the second ray is the beam, all zero: its variance then stands for the other camera's
-- Latency     with B = G_BITS_PER_STAGE: fuse_latency(B) = 32 + ceil(22 / B) + ceil(32 / B); the place in the beam's
--             frame fuse_beam_latency(B) = 29 + ceil(22 / B); what the plain average needs 5 clocks before that
-- Throughput  one per clock. No reset: data only
-- Resources   32 multipliers, seven divisions with quotients of 18 to 31 bits, one root of 48 bits
-- Twin        karst_core's weighted.rs: stereo, single; fusion.rs: BeamRay; calibration.rs: variance_at

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.rounding.all;
use work.reconstructor_pkg.all;

entity fuse is
  generic (
    G_BITS_PER_STAGE : positive range 2 to 8  -- of divisions and root
  );
  port (
    clk                : in  std_ulogic;           -- rising edge
    plain              : in  std_ulogic;           -- do not move the crossing: for the plain average. Constant
    chi2_max           : in  signed(31 downto 0);  -- Q18.14, constant
    single             : in  std_ulogic;           -- the second ray is the beam
    ray_a              : in  beam_ray_t;           -- first ray
    ray_b              : in  beam_ray_t;           -- second ray; all zero if it is the beam
    exists             : in  std_ulogic;           -- from crossing, and so
    along              : in  signed(29 downto 0);  -- mm, Q.16
    inverse_slope      : in  signed(35 downto 0);  -- Q.28
    origin_variance    : in  signed(43 downto 0);  -- of the beam, mm**2, Q.32
    direction_variance : in  signed(33 downto 0);  -- of the beam, rad**2, Q.44
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

  -- Clocks after the crossing
  constant T_SHARES     : positive := 3;
  constant T_UP         : positive := 4;
  constant T_BEAM_VAR   : positive := 5;
  constant T_ACROSS_VAR : positive := 4;
  constant T_WHOLE      : positive := T_ACROSS_VAR + 1;
  constant T_UP_VAR     : positive := 7;
  constant T_TOTAL      : positive := T_UP_VAR + 4;
  constant T_SHARE      : positive := T_WHOLE + divide_latency(18, G_BITS_PER_STAGE);
  constant T_ACROSS_TOTAL : positive := T_SHARE + 3;
  constant T_RATIO_ACROSS : positive := T_ACROSS_TOTAL + divide_latency(18, G_BITS_PER_STAGE);
  constant T_RATIO_UP   : positive := T_TOTAL + divide_latency(18, G_BITS_PER_STAGE);
  constant T_GAIN       : positive := T_TOTAL + divide_latency(21, G_BITS_PER_STAGE);
  constant T_CORRECTED  : positive := T_GAIN + 6;
  constant T_OFFSETS    : positive := T_CORRECTED + 3;
  constant T_DIFFERENCE : positive := T_OFFSETS + 1;
  constant T_ACROSS     : positive := T_DIFFERENCE + 3;
  constant T_PLAIN      : positive := T_DIFFERENCE + 1;
  constant T_BEAM       : positive := fuse_beam_latency(G_BITS_PER_STAGE);
  constant T_ROOT       : positive := T_GAIN + 4 + root_latency(24, G_BITS_PER_STAGE);
  constant T_POINT      : positive := fuse_latency(G_BITS_PER_STAGE);

  -- Share of one in Q.16
  constant WHOLE : signed(17 downto 0) := to_signed(2 ** 16, 18);

  -- A variance that rounds to zero counts as its last bit
  function at_least_one(variance : signed) return std_ulogic_vector is
    variable v : signed(variance'length - 1 downto 0) := variance;
  begin
    if v = 0 then
      v(0) := '1';
    end if;
    return std_ulogic_vector(v);
  end function;

  type rays_t     is array (0 to 1) of beam_ray_t;
  type words_19_t is array (0 to 1) of signed(18 downto 0);
  type words_20_t is array (0 to 1) of signed(19 downto 0);
  type words_34_t is array (0 to 1) of signed(33 downto 0);
  type words_35_t is array (0 to 1) of signed(34 downto 0);
  type words_38_t is array (0 to 1) of signed(37 downto 0);
  type words_44_t is array (0 to 1) of signed(43 downto 0);
  type words_48_t is array (0 to 1) of signed(47 downto 0);
  type words_40_t is array (0 to 1) of signed(39 downto 0);
  type words_61_t is array (0 to 1) of signed(60 downto 0);
  type words_62_t is array (0 to 1) of signed(61 downto 0);
  type words_63_t is array (0 to 1) of signed(62 downto 0);
  type words_64_t is array (0 to 1) of signed(63 downto 0);
  type words_66_t is array (0 to 1) of signed(65 downto 0);
  type words_67_t is array (0 to 1) of signed(66 downto 0);

  signal rays : rays_t;

  signal single_at : std_ulogic_vector(0 to T_POINT);
  signal exists_at : std_ulogic_vector(0 to T_UP);

  -- Up
  signal share_products     : words_67_t;
  signal shares_wide        : words_40_t;
  signal shares             : words_19_t;  -- b1 and -b2, Q.16
  signal shares_fit         : std_ulogic;
  signal share_squares      : words_38_t;
  signal share_squares_late : words_20_t;
  signal shares_late        : words_19_t;
  signal up_product         : signed(60 downto 0);
  signal up_start           : signed(31 downto 0);
  signal up_fine            : signed(38 downto 0);  -- Q.20
  signal up                 : signed(32 downto 0);  -- Q.16
  signal lever_products     : words_62_t;
  signal start_levers       : words_t(0 to 1);
  signal levers             : words_20_t;  -- mm per unit of s, Q.4
  signal lever_squares      : words_40_t;
  signal variances          : words_64_t;
  signal spot_variances     : rays_t;
  signal up_variances       : words_44_t;  -- Q.32
  signal variance_products  : words_64_t;
  signal up_variance        : signed(49 downto 0);
  signal up_total           : signed(49 downto 0);
  signal covariance_products : words_63_t;
  signal covariance_wide    : signed(48 downto 0);
  signal covariance         : signed(45 downto 0);
  signal gain               : std_ulogic_vector(20 downto 0);  -- Q.16

  -- Beam
  signal distance         : signed(15 downto 0);  -- Q.2
  signal square           : signed(31 downto 0);
  signal origin_late      : signed(43 downto 0);
  signal direction_late   : signed(33 downto 0);
  signal direction_product : signed(65 downto 0);
  signal beam_variance    : signed(47 downto 0);  -- Q.32
  signal beam_at_up_var   : signed(47 downto 0);
  signal beam_at_up_sum   : signed(47 downto 0);
  signal beam_at_total    : signed(47 downto 0);
  signal beam_at_share    : signed(47 downto 0);
  signal beam_at_across   : signed(47 downto 0);

  -- Along
  signal up_at_gain       : signed(26 downto 0);
  signal up_near          : signed(26 downto 0);  -- up, if it is not inconsistent
  signal pull_product     : signed(47 downto 0);
  signal pull             : signed(30 downto 0);
  signal inverse_at_pull  : signed(35 downto 0);
  signal shift_product    : signed(66 downto 0);
  signal along_at_shift   : signed(29 downto 0);
  signal corrected        : signed(37 downto 0);
  signal covariance_late  : signed(45 downto 0);
  signal reduction_product : signed(66 downto 0);
  signal reduction        : signed(51 downto 0);
  signal variance_sum     : signed(48 downto 0);
  signal variance_sum_late : signed(48 downto 0);
  signal along_variance   : std_ulogic_vector(47 downto 0);
  signal root             : std_ulogic_vector(23 downto 0);
  signal root_signed      : signed(24 downto 0);
  signal inverse_at_root  : signed(35 downto 0);
  signal sigma_product    : signed(60 downto 0);
  signal sigma_fine       : signed(34 downto 0);
  signal sigma_here       : signed(31 downto 0);

  -- Across
  signal azimuths         : words_34_t;
  signal across_products  : words_66_t;
  signal across_variances : words_48_t;  -- Q.32
  signal whole_variance   : signed(49 downto 0);
  signal second_variance  : signed(47 downto 0);
  signal share_numerator  : std_ulogic_vector(63 downto 0);
  signal share_quotient   : std_ulogic_vector(17 downto 0);
  signal across_share     : signed(17 downto 0);  -- of the first ray, Q.16
  signal first_variance   : signed(47 downto 0);
  signal mean_product     : signed(65 downto 0);
  signal across_total     : signed(49 downto 0);
  signal slopes           : rays_t;
  signal offset_products  : words_61_t;
  signal offset_starts    : words_t(0 to 1);
  signal offsets          : words_35_t;  -- Q.16
  signal second_offset    : signed(34 downto 0);
  signal second_late      : signed(26 downto 0);
  signal difference       : signed(26 downto 0);
  signal sum              : signed(35 downto 0);
  signal share_late       : signed(17 downto 0);
  signal mean_shift       : signed(44 downto 0);
  signal across           : signed(26 downto 0);

  -- Point
  signal ratio_numerator  : std_ulogic_vector(63 downto 0);
  signal ratio_up         : std_ulogic_vector(17 downto 0);
  signal ratio_across     : std_ulogic_vector(17 downto 0);
  signal ratio_across_late : signed(17 downto 0);
  signal across_numerator : std_ulogic_vector(63 downto 0);
  signal up_at_ratio      : signed(26 downto 0);
  signal up_scaled        : signed(44 downto 0);
  signal across_scaled    : signed(44 downto 0);
  signal beam_up_here     : signed(32 downto 0);
  signal corrected_fit    : signed(32 downto 0);

  -- chi squared, Q.12
  signal up_square           : signed(53 downto 0);
  signal up_square_late      : signed(53 downto 0);
  signal difference_square   : signed(53 downto 0);
  signal across_square       : signed(53 downto 0);
  signal up_numerator        : std_ulogic_vector(63 downto 0);
  signal difference_numerator : std_ulogic_vector(63 downto 0);
  signal across_chi_numerator : std_ulogic_vector(63 downto 0);
  signal whole_late          : signed(49 downto 0);
  signal across_total_late   : signed(49 downto 0);
  signal chi2_up             : std_ulogic_vector(30 downto 0);
  signal chi2_difference     : std_ulogic_vector(30 downto 0);
  signal chi2_across         : std_ulogic_vector(30 downto 0);
  signal chi2_up_late        : signed(30 downto 0);
  signal chi2_difference_late : signed(30 downto 0);
  signal chi2_sum            : signed(31 downto 0);

  -- Variances to divide by
  signal up_total_divisor          : std_ulogic_vector(49 downto 0);
  signal whole_variance_divisor    : std_ulogic_vector(49 downto 0);
  signal across_total_divisor      : std_ulogic_vector(49 downto 0);
  signal whole_late_divisor        : std_ulogic_vector(49 downto 0);
  signal across_total_late_divisor : std_ulogic_vector(49 downto 0);

  -- What is known of the outcome
  signal outcome_crossing : outcome_t;
  signal outcome_late     : signed(2 downto 0);
  signal outcome_reach    : outcome_t;
  signal outcome_reach_late : signed(2 downto 0);
  signal outcome_offsets  : outcome_t;
  signal outcome_offsets_late : signed(2 downto 0);

begin

  rays <= (ray_a, ray_b);

  single_at(0) <= single;
  exists_at(0) <= exists;
  single_at(1 to T_POINT) <= single_at(0 to T_POINT - 1) when rising_edge(clk);
  exists_at(1 to T_UP)    <= exists_at(0 to T_UP - 1) when rising_edge(clk);

  -- The beam's variance at this distance; of the distance a quarter of a millimetre is enough

  distance <= '0' & along(28 downto 14);
  square_i : entity work.multiply
    generic map (G_A_WIDTH => 16, G_B_WIDTH => 16)
    port map (clk => clk, a => distance, b => distance, product => square);
  direction_i : entity work.delay
    generic map (G_WIDTH => 34, G_CLOCKS => 2)
    port map (clk => clk, value => direction_variance, later => direction_late);
  origin_i : entity work.delay
    generic map (G_WIDTH => 44, G_CLOCKS => T_BEAM_VAR - 1)
    port map (clk => clk, value => origin_variance, later => origin_late);
  beam_variance_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 34)
    port map (clk => clk, a => square, b => direction_late, product => direction_product);
  beam_at_up_var_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_UP_VAR - T_BEAM_VAR)
    port map (clk => clk, value => beam_variance, later => beam_at_up_var);
  beam_at_up_sum_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_TOTAL - 1 - T_UP_VAR)
    port map (clk => clk, value => beam_at_up_var, later => beam_at_up_sum);
  beam_at_total_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => 1)
    port map (clk => clk, value => beam_at_up_sum, later => beam_at_total);
  beam_at_share_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_ACROSS_TOTAL - 1 - T_TOTAL)
    port map (clk => clk, value => beam_at_total, later => beam_at_share);
  beam_at_across_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => 1)
    port map (clk => clk, value => beam_at_share, later => beam_at_across);

  -- Both rays' variances

  rays_g : for i in 0 to 1 generate
    signal ray_vector      : signed(BEAM_RAY_WIDTH - 1 downto 0);
    signal variance_vector : signed(BEAM_RAY_WIDTH - 1 downto 0);
    signal slope_vector    : signed(BEAM_RAY_WIDTH - 1 downto 0);
  begin

    ray_vector <= to_vector(rays(i));
    variance_i : entity work.delay
      generic map (G_WIDTH => BEAM_RAY_WIDTH, G_CLOCKS => T_UP_VAR - 2)
      port map (clk => clk, value => ray_vector, later => variance_vector);
    spot_variances(i) <= to_beam_ray(variance_vector);
    slope_i : entity work.delay
      generic map (G_WIDTH => BEAM_RAY_WIDTH, G_CLOCKS => T_CORRECTED - T_UP_VAR + 2)
      port map (clk => clk, value => variance_vector, later => slope_vector);
    slopes(i) <= to_beam_ray(slope_vector);

    up_share_i : entity work.multiply
      generic map (G_A_WIDTH => 31, G_B_WIDTH => 36)
      port map (clk => clk, a => rays(i).up_slope, b => inverse_slope, product => share_products(i));
    up_share_square_i : entity work.multiply
      generic map (G_A_WIDTH => 19, G_B_WIDTH => 19)
      port map (clk => clk, a => shares(i), b => shares(i), product => share_squares(i));
    up_share_square_late_i : entity work.delay
      generic map (G_WIDTH => 20, G_CLOCKS => T_UP_VAR - T_SHARES - 2)
      port map (clk => clk, value => share_squares(i)(35 downto 16), later => share_squares_late(i));
    up_share_late_i : entity work.delay
      generic map (G_WIDTH => 19, G_CLOCKS => T_UP_VAR - T_SHARES)
      port map (clk => clk, value => shares(i), later => shares_late(i));

    lever_i : entity work.multiply
      generic map (G_A_WIDTH => 32, G_B_WIDTH => 30)
      port map (clk => clk, a => rays(i).slope_derivative, b => along, product => lever_products(i));
    start_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => 2)
      port map (clk => clk, value => rays(i).start_derivative, later => start_levers(i));
    lever_square_i : entity work.multiply
      generic map (G_A_WIDTH => 20, G_B_WIDTH => 20)
      port map (clk => clk, a => levers(i), b => levers(i), product => lever_squares(i));
    up_variance_i : entity work.multiply
      generic map (G_A_WIDTH => 38, G_B_WIDTH => 26)
      port map (clk => clk, a => lever_squares(i)(37 downto 0), b => spot_variances(i).variance, product => variances(i));
    up_variances(i) <= variances(i)(61 downto 18);

    azimuth_i : entity work.delay
      generic map (G_WIDTH => 34, G_CLOCKS => 2)
      port map (clk => clk, value => rays(i).azimuth_variance, later => azimuths(i));
    across_variance_i : entity work.multiply
      generic map (G_A_WIDTH => 34, G_B_WIDTH => 32)
      port map (clk => clk, a => azimuths(i), b => square, product => across_products(i));
    across_variances(i) <= across_products(i)(63 downto 16);

    -- The other ray's variance
    variance_product_i : entity work.multiply
      generic map (G_A_WIDTH => 20, G_B_WIDTH => 44)
      port map (clk => clk, a => share_squares_late(i), b => up_variances(1 - i), product => variance_products(i));
    covariance_product_i : entity work.multiply
      generic map (G_A_WIDTH => 19, G_B_WIDTH => 44)
      port map (clk => clk, a => shares_late(i), b => up_variances(1 - i), product => covariance_products(i));

    offset_i : entity work.multiply
      generic map (G_A_WIDTH => 31, G_B_WIDTH => 30)
      port map (clk => clk, a => slopes(i).across_slope, b => corrected(29 downto 0), product => offset_products(i));
    offset_start_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => 2)
      port map (clk => clk, value => slopes(i).across, later => offset_starts(i));

  end generate;

  up_product_i : entity work.multiply
    generic map (G_A_WIDTH => 31, G_B_WIDTH => 30)
    port map (clk => clk, a => ray_a.up_slope, b => along, product => up_product);
  up_start_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => 2)
    port map (clk => clk, value => ray_a.up, later => up_start);

  variances_p : process (clk)
    variable lever : signed(30 downto 0);
  begin
    if rising_edge(clk) then
      beam_variance <= resize(origin_late, 48) + direction_product(63 downto 16);

      for i in 0 to 1 loop
        -- mm per unit of s at Q.4: the slope's share grows with the distance, the start's does not
        lever := resize(lever_products(i)(61 downto 32), 31) + start_levers(i)(31 downto 4);
        if within(lever, 18) then
          levers(i) <= resize(lever, 20);
        elsif lever < 0 then
          levers(i) <= to_signed(-2 ** 18, 20);
        else
          levers(i) <= to_signed(2 ** 18, 20);
        end if;
      end loop;

      up_fine <= round_shift(up_product, 24) + resize(up_start, 39);
      up      <= (others => '0') when single_at(T_UP - 1) = '1' else resize(round_shift(up_fine, 4), 33);

      up_variance <= round_shift(resize(variance_products(0), 65) + variance_products(1), 16);
      up_total    <= beam_at_up_sum + up_variance;
      -- shares holds -b2
      covariance_wide <= round_shift(resize(covariance_products(0), 64) + covariance_products(1), 16);
      covariance      <= (others => '0') when plain = '1' else resize(covariance_wide, 46);
      variance_sum    <= resize(up_variances(0), 49) + beam_at_up_var when single_at(T_UP_VAR) = '1' else
                         resize(up_variances(0), 49) + up_variances(1);

      whole_variance <= resize(across_variances(0), 50) + across_variances(1);
    end if;
  end process;

  shares_p : process (clk)
  begin
    if rising_edge(clk) then
      for i in 0 to 1 loop
        shares_wide(i) <= resize(round_shift(share_products(i), 40), 40);
      end loop;
      shares_fit <= '1' when within(shares_wide(0), 17) and within(shares_wide(1), 17) else '0';

      if exists_at(T_UP) = '0' or shares_fit = '0' then
        outcome_crossing <= NO_INTERSECTION;
      elsif not within(up, 25) then
        outcome_crossing <= INCONSISTENT;
      else
        outcome_crossing <= POINT;
      end if;
    end if;
  end process;

  shares  <= (resize(shares_wide(0), 19), resize(shares_wide(1), 19));
  up_near <= resize(up, 27);

  -- (GHDL 2.0 does not convert functions of one argument within port maps)
  up_total_divisor          <= at_least_one(up_total);
  whole_variance_divisor    <= at_least_one(whole_variance);
  across_total_divisor      <= at_least_one(across_total);
  whole_late_divisor        <= at_least_one(whole_late);
  across_total_late_divisor <= at_least_one(across_total_late);

  -- The beam pulls the crossing

  gain_i : entity work.divide
    generic map (G_NUMERATOR_WIDTH => 62, G_DENOMINATOR_WIDTH => 50, G_QUOTIENT_WIDTH => 21,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1',
              numerator => std_ulogic_vector(shift_left(resize(covariance, 62), 16)),
              denominator => up_total_divisor, out_valid => open, quotient => gain);
  up_at_gain_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_GAIN - T_UP)
    port map (clk => clk, value => up_near, later => up_at_gain);
  pull_i : entity work.multiply
    generic map (G_A_WIDTH => 21, G_B_WIDTH => 27)
    port map (clk => clk, a => signed(gain), b => up_at_gain, product => pull_product);
  inverse_at_pull_i : entity work.delay
    generic map (G_WIDTH => 36, G_CLOCKS => T_CORRECTED - 3)
    port map (clk => clk, value => inverse_slope, later => inverse_at_pull);
  shift_i : entity work.multiply
    generic map (G_A_WIDTH => 31, G_B_WIDTH => 36)
    port map (clk => clk, a => pull, b => inverse_at_pull, product => shift_product);
  along_at_shift_i : entity work.delay
    generic map (G_WIDTH => 30, G_CLOCKS => T_CORRECTED - 1)
    port map (clk => clk, value => along, later => along_at_shift);
  outcome_crossing_i : entity work.delay
    generic map (G_WIDTH => 3, G_CLOCKS => T_CORRECTED - T_UP - 1)
    port map (clk => clk, value => signed(outcome_crossing), later => outcome_late);

  correct_p : process (clk)
  begin
    if rising_edge(clk) then
      pull      <= resize(round_shift(pull_product, 16), 31);
      corrected <= resize(along_at_shift, 38) - resize(round_shift(shift_product, 28), 38);

      outcome_reach <= unsigned(outcome_late);
      if unsigned(outcome_late) = POINT and not in_reach(corrected) then
        outcome_reach <= OUT_OF_RANGE;
      end if;
    end if;
  end process;

  -- Standard deviation along the beam

  covariance_i : entity work.delay
    generic map (G_WIDTH => 46, G_CLOCKS => T_GAIN - T_TOTAL)
    port map (clk => clk, value => covariance, later => covariance_late);
  reduction_i : entity work.multiply
    generic map (G_A_WIDTH => 21, G_B_WIDTH => 46)
    port map (clk => clk, a => signed(gain), b => covariance_late, product => reduction_product);
  variance_sum_i : entity work.delay
    generic map (G_WIDTH => 49, G_CLOCKS => T_GAIN + 3 - T_UP_VAR - 1)
    port map (clk => clk, value => variance_sum, later => variance_sum_late);
  root_i : entity work.sqrt
    generic map (G_WIDTH => 48, G_ROUND => true, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1', radicand => along_variance, out_valid => open, root => root);
  root_signed <= signed('0' & root);
  inverse_at_root_i : entity work.delay
    generic map (G_WIDTH => 36, G_CLOCKS => T_ROOT - T_CORRECTED + 3)
    port map (clk => clk, value => inverse_at_pull, later => inverse_at_root);
  sigma_i : entity work.multiply
    generic map (G_A_WIDTH => 25, G_B_WIDTH => 36)
    port map (clk => clk, a => root_signed, b => inverse_at_root, product => sigma_product);

  sigma_p : process (clk)
    variable remaining : signed(52 downto 0);
  begin
    if rising_edge(clk) then
      reduction <= round_shift(reduction_product, 16);
      remaining := resize(variance_sum_late, 53) - reduction;
      along_variance <= (others => '0') when remaining < 0 else std_ulogic_vector(remaining(47 downto 0));
      sigma_fine     <= signed(magnitude(round_shift(sigma_product, 28)));
      sigma_here     <= saturate(round_shift(sigma_fine, 2), 32);
    end if;
  end process;

  sigma_late_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_POINT - T_ROOT - 4)
    port map (clk => clk, value => sigma_here, later => sigma);

  -- Across: mean of the rays by their variances

  second_variance <= across_variances(1) when rising_edge(clk);
  share_numerator <= std_ulogic_vector(shift_left(resize(second_variance, 64), 16));
  share_i : entity work.divide
    generic map (G_NUMERATOR_WIDTH => 64, G_DENOMINATOR_WIDTH => 50, G_QUOTIENT_WIDTH => 18,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1', numerator => share_numerator,
              denominator => whole_variance_divisor, out_valid => open, quotient => share_quotient);
  across_share <= WHOLE when single_at(T_SHARE) = '1' else signed(share_quotient);
  first_variance_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_SHARE - T_ACROSS_VAR)
    port map (clk => clk, value => across_variances(0), later => first_variance);
  mean_i : entity work.multiply
    generic map (G_A_WIDTH => 48, G_B_WIDTH => 18)
    port map (clk => clk, a => first_variance, b => across_share, product => mean_product);
  share_late_i : entity work.delay
    generic map (G_WIDTH => 18, G_CLOCKS => T_DIFFERENCE - T_SHARE)
    port map (clk => clk, value => across_share, later => share_late);
  second_offset <= offsets(0) when single_at(T_OFFSETS) = '1' else offsets(1);
  second_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_ACROSS - 1 - T_OFFSETS)
    port map (clk => clk, value => second_offset(26 downto 0), later => second_late);
  mean_shift_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 18)
    port map (clk => clk, a => difference, b => share_late, product => mean_shift);
  outcome_reach_i : entity work.delay
    generic map (G_WIDTH => 3, G_CLOCKS => T_OFFSETS - T_CORRECTED - 1)
    port map (clk => clk, value => signed(outcome_reach), later => outcome_reach_late);

  across_p : process (clk)
    variable near : boolean;
  begin
    if rising_edge(clk) then
      across_total <= resize(round_shift(mean_product, 16), 50) + beam_at_share;

      for i in 0 to 1 loop
        offsets(i) <= round_shift(offset_products(i), 28) + resize(round_shift(offset_starts(i), 4), 35);
      end loop;
      difference <= resize(offsets(0) - second_offset, 27);
      sum        <= resize(offsets(0), 36) + second_offset;
      if single_at(T_OFFSETS) = '1' then
        near := within(offsets(0), 25);
      else
        near := within(offsets(0), 24) and within(offsets(1), 24);
      end if;
      outcome_offsets <= unsigned(outcome_reach_late);
      if unsigned(outcome_reach_late) = POINT and not near then
        outcome_offsets <= INCONSISTENT;
      end if;

      across <= resize(second_late + round_shift(mean_shift, 16), 27);
    end if;
  end process;

  -- The beam pulls up and across

  ratio_numerator <= std_ulogic_vector(shift_left(resize(beam_at_total, 64), 16));
  ratio_up_i : entity work.divide
    generic map (G_NUMERATOR_WIDTH => 64, G_DENOMINATOR_WIDTH => 50, G_QUOTIENT_WIDTH => 18,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1', numerator => ratio_numerator,
              denominator => up_total_divisor, out_valid => open, quotient => ratio_up);
  up_at_ratio_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_RATIO_UP - T_UP)
    port map (clk => clk, value => up_near, later => up_at_ratio);
  up_scaled_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 18)
    port map (clk => clk, a => up_at_ratio, b => signed(ratio_up), product => up_scaled);
  beam_up_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_BEAM - T_RATIO_UP - 3)
    port map (clk => clk, value => beam_up_here, later => beam_up);

  across_numerator <= std_ulogic_vector(shift_left(resize(beam_at_across, 64), 16));
  ratio_across_i : entity work.divide
    generic map (G_NUMERATOR_WIDTH => 64, G_DENOMINATOR_WIDTH => 50, G_QUOTIENT_WIDTH => 18,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1', numerator => across_numerator,
              denominator => across_total_divisor, out_valid => open, quotient => ratio_across);
  ratio_across_late_i : entity work.delay
    generic map (G_WIDTH => 18, G_CLOCKS => T_ACROSS - T_RATIO_ACROSS)
    port map (clk => clk, value => signed(ratio_across), later => ratio_across_late);
  across_scaled_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 18)
    port map (clk => clk, a => across, b => ratio_across_late, product => across_scaled);

  scale_p : process (clk)
  begin
    if rising_edge(clk) then
      beam_up_here <= resize(round_shift(up_scaled, 16), 33);
      beam_across  <= resize(round_shift(across_scaled, 16), 33);
    end if;
  end process;

  corrected_fit <= resize(corrected, 33);
  plain_along_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_PLAIN - T_CORRECTED)
    port map (clk => clk, value => corrected_fit, later => plain_along);
  beam_along_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_BEAM - T_CORRECTED)
    port map (clk => clk, value => corrected_fit, later => beam_along);
  plain_up_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_PLAIN - T_UP)
    port map (clk => clk, value => up, later => plain_up);
  plain_across <= resize(round_shift(sum, 1), 33) when rising_edge(clk);

  -- chi squared: three terms, each a square over its variance

  up_square_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 27)
    port map (clk => clk, a => up_near, b => up_near, product => up_square);
  up_square_late_i : entity work.delay
    generic map (G_WIDTH => 54, G_CLOCKS => T_TOTAL - T_UP - 2)
    port map (clk => clk, value => up_square, later => up_square_late);
  difference_square_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 27)
    port map (clk => clk, a => difference, b => difference, product => difference_square);
  across_square_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 27)
    port map (clk => clk, a => across, b => across, product => across_square);

  up_numerator         <= std_ulogic_vector(shift_left(resize(up_square_late, 64), 12));
  difference_numerator <= std_ulogic_vector(shift_left(resize(difference_square, 64), 12));
  across_chi_numerator <= std_ulogic_vector(shift_left(resize(across_square, 64), 12));

  whole_i : entity work.delay
    generic map (G_WIDTH => 50, G_CLOCKS => T_DIFFERENCE + 2 - T_WHOLE)
    port map (clk => clk, value => whole_variance, later => whole_late);
  across_total_i : entity work.delay
    generic map (G_WIDTH => 50, G_CLOCKS => T_ACROSS + 2 - T_ACROSS_TOTAL)
    port map (clk => clk, value => across_total, later => across_total_late);

  chi2_up_i : entity work.divide
    generic map (G_NUMERATOR_WIDTH => 64, G_DENOMINATOR_WIDTH => 50, G_QUOTIENT_WIDTH => 31,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1', numerator => up_numerator,
              denominator => up_total_divisor, out_valid => open, quotient => chi2_up);
  chi2_difference_i : entity work.divide
    generic map (G_NUMERATOR_WIDTH => 64, G_DENOMINATOR_WIDTH => 50, G_QUOTIENT_WIDTH => 31,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1', numerator => difference_numerator,
              denominator => whole_late_divisor, out_valid => open, quotient => chi2_difference);
  chi2_across_i : entity work.divide
    generic map (G_NUMERATOR_WIDTH => 64, G_DENOMINATOR_WIDTH => 50, G_QUOTIENT_WIDTH => 31,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, rst => '0', in_valid => '1', numerator => across_chi_numerator,
              denominator => across_total_late_divisor, out_valid => open, quotient => chi2_across);
  chi2_up_late_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_ACROSS + 2 - T_TOTAL)
    port map (clk => clk, value => signed(chi2_up), later => chi2_up_late);
  chi2_difference_late_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_ACROSS - T_DIFFERENCE)
    port map (clk => clk, value => signed(chi2_difference), later => chi2_difference_late);
  outcome_offsets_i : entity work.delay
    generic map (G_WIDTH => 3, G_CLOCKS => T_POINT - 1 - T_DIFFERENCE)
    port map (clk => clk, value => signed(outcome_offsets), later => outcome_offsets_late);

  point_p : process (clk)
    variable terms : signed(32 downto 0);
  begin
    if rising_edge(clk) then
      -- A term at the end of its 31 bits makes the sum, in Q.14, saturate
      terms    := resize(chi2_up_late, 33) + chi2_difference_late + signed(chi2_across);
      chi2_sum <= saturate(terms & "00", 32);

      chi2    <= chi2_sum;
      outcome <= unsigned(outcome_offsets_late);
      if unsigned(outcome_offsets_late) = POINT and chi2_sum > chi2_max then
        outcome <= INCONSISTENT;
      end if;
    end if;
  end process;

end architecture;
