-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Weighted least squares of two rays and an uncertain laser beam, one pair per clock.
--
-- Purpose     a crossing becomes a point with its standard deviation and chi squared, or the reason why not. With one
--             camera the second ray is the beam, all zero: its variance then stands for the other camera's
-- Latency     with B = G_BITS_PER_STAGE: fuse_latency(B) = 27 + ceil(20 / B) + ceil(30 / B); the place in the beam's
--             frame fuse_beam_latency(B); what the plain average needs fuse_plain_latency(B) = 22 + ceil(20 / B)
-- Throughput  one per clock. No reset: data only
-- Resources   32 multipliers, seven quotients of 17 to 30 bits, one root of 48 bits
-- Twin        karst_core's weighted.rs: stereo, single; fusion.rs: BeamRay; calibration.rs: variance_at

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
    inverse_slope      : in  signed(35 downto 0);  -- from crossing: magnitude, Q.28
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

  -- Clocks of what is given
  constant T_INVERSE      : positive := 1;
  constant T_ALONG        : positive := 3;
  -- Clocks of what is made
  constant T_SHARES       : positive := T_INVERSE + 2;
  constant T_SQUARE       : positive := T_ALONG + 2;
  constant T_UP           : positive := T_ALONG + 3;
  constant T_BEAM_VAR     : positive := T_SQUARE + 2;
  constant T_ACROSS_VAR   : positive := T_SQUARE + 2;
  constant T_WHOLE        : positive := T_ACROSS_VAR + 1;
  constant T_LEVER_SQUARE : positive := T_ALONG + 5;
  constant T_UP_VAR       : positive := T_LEVER_SQUARE + 2;
  constant T_TOTAL        : positive := T_UP_VAR + 3;
  constant T_SHARE        : positive := T_WHOLE + quotient_latency(17, FEW_BITS);
  constant T_ACROSS_TOTAL : positive := T_SHARE + 2;
  constant T_RATIO_ACROSS : positive := T_ACROSS_TOTAL + quotient_latency(17, FEW_BITS);
  constant T_RATIO_UP     : positive := T_TOTAL + quotient_latency(17, FEW_BITS);
  constant T_CHI_UP       : positive := T_TOTAL + quotient_latency(30, FEW_BITS);
  constant T_GAIN         : positive := T_TOTAL + quotient_latency(20, G_BITS_PER_STAGE);
  constant T_CORRECTED    : positive := T_GAIN + 4;
  constant T_OFFSETS      : positive := T_CORRECTED + 2;
  constant T_DIFFERENCE   : positive := T_OFFSETS + 1;
  constant T_PLAIN        : positive := T_DIFFERENCE + 1;
  constant T_ACROSS       : positive := T_DIFFERENCE + 2;
  constant T_SCALE        : positive := maximum(T_ACROSS, T_RATIO_ACROSS);
  constant T_BEAM         : positive := T_SCALE + 2;
  constant T_CHI          : positive := T_ACROSS + 2 + quotient_latency(30, G_BITS_PER_STAGE);
  constant T_REMAINING    : positive := T_GAIN + 3;
  constant T_ROOT         : positive := T_REMAINING + root_latency(24, FEW_BITS);
  constant T_POINT        : positive := T_CHI + 1;

  -- Share of one in Q.16
  constant WHOLE : signed(17 downto 0) := to_signed(2 ** 16, 18);

  -- Bits below the point of an addend: half, or less by one, which rounds the negative of a product as if its sign were
  -- turned after rounding
  constant LESS_16 : signed(15 downto 0) := "0111111111111111";
  constant HALF_16 : signed(15 downto 0) := "1000000000000000";
  constant LESS_28 : signed(27 downto 0) := "0111111111111111111111111111";
  constant HALF_28 : signed(27 downto 0) := "1000000000000000000000000000";

  type rays_t     is array (0 to 1) of beam_ray_t;
  type words_19_t is array (0 to 1) of signed(18 downto 0);
  type words_20_t is array (0 to 1) of signed(19 downto 0);
  type words_27_t is array (0 to 1) of signed(26 downto 0);
  type words_29_t is array (0 to 1) of signed(28 downto 0);
  type words_31_t is array (0 to 1) of signed(30 downto 0);
  type words_33_t is array (0 to 1) of signed(32 downto 0);
  type words_34_t is array (0 to 1) of signed(33 downto 0);
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

  signal rays, at_along, at_addend, at_square, at_lever, at_offset : rays_t;  -- at the clocks of these

  signal single_at : std_ulogic_vector(0 to T_POINT);
  signal exists_at : std_ulogic_vector(T_ALONG to T_UP);
  signal falls_at  : std_ulogic_vector(0 to T_ROOT + 1);

  -- Up
  signal slopes             : words_31_t;  -- the rays', turned if the difference of the slopes is negative
  signal share_products     : words_67_t;
  signal shares_wide        : words_27_t;
  signal shares             : words_19_t;  -- b1 and -b2, Q.16
  signal shares_fit         : std_ulogic_vector(T_SHARES + 1 to T_UP);
  signal share_squares      : words_38_t;
  signal share_squares_late : words_20_t;
  signal shares_late        : words_19_t;
  signal up_product         : signed(60 downto 0);
  signal up_addend          : signed(60 downto 0);
  signal up                 : signed(32 downto 0);  -- Q.16
  signal lever_products     : words_62_t;
  signal lever_addends      : words_62_t;
  signal levers             : words_20_t;  -- mm per unit of s, Q.4
  signal lever_squares      : words_40_t;
  signal variances          : words_64_t;
  signal up_variances       : words_44_t;  -- Q.32
  signal variance_products  : words_64_t;
  signal up_total           : signed(49 downto 0);
  signal covariance_products : words_63_t;
  signal covariance         : signed(45 downto 0);
  signal gain_numerator     : signed(61 downto 0);
  signal gain               : unsigned(19 downto 0);  -- magnitude, Q.16
  signal gain_factor        : signed(20 downto 0);

  -- Beam
  signal distance         : signed(15 downto 0);  -- Q.2
  signal square           : signed(31 downto 0);
  signal origin_late      : signed(43 downto 0);
  signal direction_late   : signed(33 downto 0);
  signal beam_addend      : signed(65 downto 0);
  signal beam_product     : signed(65 downto 0);
  signal beam_variance    : signed(47 downto 0);  -- Q.32
  signal beam_at_up_var   : signed(47 downto 0);
  signal beam_at_up_sum   : signed(47 downto 0);
  signal beam_at_total    : signed(47 downto 0);
  signal beam_at_mean     : signed(47 downto 0);
  signal beam_at_across   : signed(47 downto 0);

  -- Along
  signal up_near          : signed(26 downto 0);  -- up, if it is not inconsistent
  signal up_at_total      : signed(26 downto 0);
  signal up_turned        : signed(26 downto 0);  -- by the sign of the covariance
  signal up_at_gain       : signed(26 downto 0);
  signal pull_product     : signed(47 downto 0);
  signal pull             : signed(30 downto 0);
  signal inverse_turned   : signed(35 downto 0);  -- 1 / (slope of the second - slope of the first)
  signal inverse_at_pull  : signed(35 downto 0);
  signal along_late       : signed(29 downto 0);
  signal shift_addend     : signed(66 downto 0);
  signal shift_product    : signed(66 downto 0);
  signal corrected        : signed(38 downto 0);
  signal covariance_size  : signed(45 downto 0);  -- the negative of the magnitude
  signal covariance_late  : signed(45 downto 0);
  signal variance_sum     : signed(48 downto 0);
  signal variance_sum_late : signed(48 downto 0);
  signal remaining_addend : signed(66 downto 0);
  signal remaining        : signed(66 downto 0);
  signal along_variance   : std_ulogic_vector(47 downto 0);
  signal root             : std_ulogic_vector(23 downto 0);
  signal root_factor      : signed(24 downto 0);
  signal inverse_at_root  : signed(35 downto 0);
  signal sigma_addend     : signed(60 downto 0);
  signal sigma_product    : signed(60 downto 0);
  signal sigma_fine       : signed(32 downto 0);
  signal sigma_here       : signed(31 downto 0);

  -- Across
  signal azimuths         : words_34_t;
  signal across_products  : words_66_t;
  signal across_variances : words_48_t;  -- Q.32
  signal whole_variance   : signed(49 downto 0);
  signal second_variance  : signed(47 downto 0);
  signal share_numerator  : signed(63 downto 0);
  signal share_quotient   : unsigned(16 downto 0);
  signal across_share     : signed(17 downto 0);  -- of the first ray, Q.16
  signal first_variance   : signed(47 downto 0);
  signal mean_addend      : signed(65 downto 0);
  signal mean_product     : signed(65 downto 0);
  signal across_total     : signed(49 downto 0);
  signal offset_starts    : words_29_t;
  signal offset_addends   : words_61_t;
  signal offset_products  : words_61_t;
  signal offsets          : words_33_t;  -- Q.16
  signal second_offset    : signed(32 downto 0);
  signal second_late      : signed(26 downto 0);
  signal difference       : signed(26 downto 0);
  signal sum              : signed(33 downto 0);
  signal share_late       : signed(17 downto 0);
  signal mean_shift_addend : signed(44 downto 0);
  signal mean_shift       : signed(44 downto 0);
  signal across           : signed(26 downto 0);

  -- Point
  signal ratio_up_numerator  : signed(63 downto 0);
  signal ratio_up            : unsigned(16 downto 0);
  signal ratio_up_factor     : signed(17 downto 0);
  signal ratio_across_numerator : signed(63 downto 0);
  signal ratio_across        : unsigned(16 downto 0);
  signal ratio_across_factor : signed(17 downto 0);
  signal ratio_across_late   : signed(17 downto 0);
  signal across_at_scale     : signed(26 downto 0);
  signal up_at_ratio         : signed(26 downto 0);
  signal up_scaled           : signed(44 downto 0);
  signal across_scaled       : signed(44 downto 0);
  signal beam_up_here        : signed(32 downto 0);
  signal corrected_fit       : signed(32 downto 0);

  -- chi squared, Q.12
  signal up_square            : signed(53 downto 0);
  signal up_square_late       : signed(53 downto 0);
  signal difference_square    : signed(53 downto 0);
  signal across_square        : signed(53 downto 0);
  signal up_numerator         : signed(63 downto 0);
  signal difference_numerator : signed(63 downto 0);
  signal across_numerator     : signed(63 downto 0);
  signal whole_late           : signed(49 downto 0);
  signal across_total_late    : signed(49 downto 0);
  signal chi2_up              : unsigned(29 downto 0);
  signal chi2_difference      : unsigned(29 downto 0);
  signal chi2_across          : unsigned(29 downto 0);
  signal chi2_up_signed       : signed(30 downto 0);
  signal chi2_up_before       : signed(30 downto 0);  -- with chi2_difference
  signal chi2_difference_late : unsigned(29 downto 0);
  signal chi2_up_late         : signed(30 downto 0);
  signal most                 : signed(33 downto 0);  -- that all three terms may be
  signal most_of_two          : signed(33 downto 0);
  signal most_of_one          : signed(33 downto 0);
  signal chi2_of_two          : signed(32 downto 0);

  -- What is known of the outcome
  signal outcome_crossing     : outcome_t;
  signal outcome_late         : signed(2 downto 0);
  signal outcome_reach        : outcome_t;
  signal outcome_reach_late   : signed(2 downto 0);
  signal outcome_offsets      : outcome_t;
  signal outcome_offsets_late : signed(2 downto 0);

  -- Variances to divide by: never negative
  signal up_total_divisor          : unsigned(48 downto 0);
  signal whole_variance_divisor    : unsigned(48 downto 0);
  signal across_total_divisor      : unsigned(48 downto 0);
  signal whole_late_divisor        : unsigned(48 downto 0);
  signal across_total_late_divisor : unsigned(48 downto 0);

begin

  rays <= (ray_a, ray_b);

  single_at(0)             <= single;
  falls_at(0)              <= falls;
  exists_at(T_ALONG)       <= exists;
  single_at(1 to T_POINT)  <= single_at(0 to T_POINT - 1) when rising_edge(clk) and enable = '1';
  falls_at(1 to T_ROOT + 1) <= falls_at(0 to T_ROOT) when rising_edge(clk) and enable = '1';
  exists_at(T_ALONG + 1 to T_UP) <= exists_at(T_ALONG to T_UP - 1) when rising_edge(clk) and enable = '1';

  -- The beam's variance at this distance; of the distance a quarter of a millimetre is enough

  distance <= '0' & along(28 downto 14);
  square_i : entity work.multiply
    generic map (G_A_WIDTH => 16, G_B_WIDTH => 16)
    port map (clk => clk, enable => enable, a => distance, b => distance, product => square);
  direction_i : entity work.delay
    generic map (G_WIDTH => 34, G_CLOCKS => T_SQUARE - T_ALONG)
    port map (clk => clk, enable => enable, value => direction_variance, later => direction_late);
  origin_i : entity work.delay
    generic map (G_WIDTH => 44, G_CLOCKS => T_BEAM_VAR - 1 - T_ALONG)
    port map (clk => clk, enable => enable, value => origin_variance, later => origin_late);
  beam_addend <= shift_left(resize(origin_late, 66), 16);
  beam_variance_i : entity work.multiply
    generic map (G_A_WIDTH => 32, G_B_WIDTH => 34)
    port map (clk => clk, enable => enable, a => square, b => direction_late, addend => beam_addend, product => beam_product);
  beam_variance <= beam_product(63 downto 16);
  beam_at_up_var_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_UP_VAR - T_BEAM_VAR)
    port map (clk => clk, enable => enable, value => beam_variance, later => beam_at_up_var);
  beam_at_up_sum_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_TOTAL - 1 - T_UP_VAR)
    port map (clk => clk, enable => enable, value => beam_at_up_var, later => beam_at_up_sum);
  beam_at_total_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => 1)
    port map (clk => clk, enable => enable, value => beam_at_up_sum, later => beam_at_total);
  beam_at_mean_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_SHARE + 1 - T_TOTAL)
    port map (clk => clk, enable => enable, value => beam_at_total, later => beam_at_mean);
  beam_at_across_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => 1)
    port map (clk => clk, enable => enable, value => beam_at_mean, later => beam_at_across);

  -- Both rays' variances

  rays_g : for i in 0 to 1 generate
    signal vector_at_0       : signed(BEAM_RAY_WIDTH - 1 downto 0);
    signal vector_at_along   : signed(BEAM_RAY_WIDTH - 1 downto 0);
    signal vector_at_addend  : signed(BEAM_RAY_WIDTH - 1 downto 0);
    signal vector_at_square  : signed(BEAM_RAY_WIDTH - 1 downto 0);
    signal vector_at_lever   : signed(BEAM_RAY_WIDTH - 1 downto 0);
    signal vector_at_offset  : signed(BEAM_RAY_WIDTH - 1 downto 0);
  begin

    vector_at_0 <= to_vector(rays(i));
    at_along_i : entity work.delay
      generic map (G_WIDTH => BEAM_RAY_WIDTH, G_CLOCKS => T_ALONG)
      port map (clk => clk, enable => enable, value => vector_at_0, later => vector_at_along);
    at_addend_i : entity work.delay
      generic map (G_WIDTH => BEAM_RAY_WIDTH, G_CLOCKS => 1)
      port map (clk => clk, enable => enable, value => vector_at_along, later => vector_at_addend);
    at_square_i : entity work.delay
      generic map (G_WIDTH => BEAM_RAY_WIDTH, G_CLOCKS => T_SQUARE - T_ALONG - 1)
      port map (clk => clk, enable => enable, value => vector_at_addend, later => vector_at_square);
    at_lever_i : entity work.delay
      generic map (G_WIDTH => BEAM_RAY_WIDTH, G_CLOCKS => T_LEVER_SQUARE - T_SQUARE)
      port map (clk => clk, enable => enable, value => vector_at_square, later => vector_at_lever);
    at_offset_i : entity work.delay
      generic map (G_WIDTH => BEAM_RAY_WIDTH, G_CLOCKS => T_CORRECTED - T_LEVER_SQUARE)
      port map (clk => clk, enable => enable, value => vector_at_lever, later => vector_at_offset);
    at_along(i) <= to_beam_ray(vector_at_along);
    at_addend(i) <= to_beam_ray(vector_at_addend);
    at_square(i) <= to_beam_ray(vector_at_square);
    at_lever(i) <= to_beam_ray(vector_at_lever);
    at_offset(i) <= to_beam_ray(vector_at_offset);

    up_share_i : entity work.multiply
      generic map (G_A_WIDTH => 31, G_B_WIDTH => 36)
      port map (clk => clk, enable => enable, a => slopes(i), b => inverse_slope, addend => half(40, 67),
                product => share_products(i));
    shares_wide(i) <= share_products(i)(66 downto 40);
    shares(i)      <= resize(shares_wide(i), 19);
    up_share_square_i : entity work.multiply
      generic map (G_A_WIDTH => 19, G_B_WIDTH => 19)
      port map (clk => clk, enable => enable, a => shares(i), b => shares(i), product => share_squares(i));
    up_share_square_late_i : entity work.delay
      generic map (G_WIDTH => 20, G_CLOCKS => T_UP_VAR - T_SHARES - 2)
      port map (clk => clk, enable => enable, value => share_squares(i)(35 downto 16), later => share_squares_late(i));
    up_share_late_i : entity work.delay
      generic map (G_WIDTH => 19, G_CLOCKS => T_UP_VAR - T_SHARES)
      port map (clk => clk, enable => enable, value => shares(i), later => shares_late(i));

    -- mm per unit of s at Q.4: the slope's share grows with the distance, the start's does not
    lever_addends(i) <= shift_left(resize(at_addend(i).start_derivative(31 downto 4), 62), 32);
    lever_i : entity work.multiply
      generic map (G_A_WIDTH => 32, G_B_WIDTH => 30)
      port map (clk => clk, enable => enable, a => at_along(i).slope_derivative, b => along, addend => lever_addends(i),
                product => lever_products(i));
    lever_square_i : entity work.multiply
      generic map (G_A_WIDTH => 20, G_B_WIDTH => 20)
      port map (clk => clk, enable => enable, a => levers(i), b => levers(i), product => lever_squares(i));
    up_variance_i : entity work.multiply
      generic map (G_A_WIDTH => 38, G_B_WIDTH => 26)
      port map (clk => clk, enable => enable, a => lever_squares(i)(37 downto 0), b => at_lever(i).variance,
                product => variances(i));
    up_variances(i) <= variances(i)(61 downto 18);

    across_variance_i : entity work.multiply
      generic map (G_A_WIDTH => 34, G_B_WIDTH => 32)
      port map (clk => clk, enable => enable, a => at_square(i).azimuth_variance, b => square, product => across_products(i));
    across_variances(i) <= across_products(i)(63 downto 16);

    -- The other ray's variance
    variance_product_i : entity work.multiply
      generic map (G_A_WIDTH => 20, G_B_WIDTH => 44)
      port map (clk => clk, enable => enable, a => share_squares_late(i), b => up_variances(1 - i),
                product => variance_products(i));
    covariance_product_i : entity work.multiply
      generic map (G_A_WIDTH => 19, G_B_WIDTH => 44)
      port map (clk => clk, enable => enable, a => shares_late(i), b => up_variances(1 - i),
                product => covariance_products(i));

    offset_starts(i)  <= round_shift(at_offset(i).across, 4) when rising_edge(clk) and enable = '1';
    offset_addends(i) <= resize(offset_starts(i) & HALF_28, 61);
    offset_i : entity work.multiply
      generic map (G_A_WIDTH => 31, G_B_WIDTH => 30)
      port map (clk => clk, enable => enable, a => at_offset(i).across_slope, b => corrected(29 downto 0),
                addend => offset_addends(i),
                product => offset_products(i));
    offsets(i) <= offset_products(i)(60 downto 28);

  end generate;

  up_addend <= resize(at_addend(0).up & half(24, 24), 61);
  up_product_i : entity work.multiply
    generic map (G_A_WIDTH => 31, G_B_WIDTH => 30)
    port map (clk => clk, enable => enable, a => at_along(0).up_slope, b => along, addend => up_addend,
              product => up_product);

  variances_p : process (clk)
    variable lever : signed(29 downto 0);
    variable total : signed(66 downto 0);
    variable cross : signed(63 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      for i in 0 to 1 loop
        slopes(i) <= -rays(i).up_slope when falls = '1' else rays(i).up_slope;

        lever := lever_products(i)(61 downto 32);
        if within(lever, 18) then
          levers(i) <= resize(lever, 20);
        elsif lever(29) = '1' then
          levers(i) <= to_signed(-2 ** 18, 20);
        else
          levers(i) <= to_signed(2 ** 18, 20);
        end if;
      end loop;

      -- Q.20 to Q.16
      up <= (others => '0') when single_at(T_UP - 1) = '1' else resize(round_shift(up_product(60 downto 24), 4), 33);

      total    := resize(beam_at_up_sum & HALF_16, 67) + variance_products(0) + variance_products(1);
      up_total <= total(65 downto 16);
      -- shares holds -b2
      cross      := resize(half(16, 64), 64) + covariance_products(0) + covariance_products(1);
      covariance <= (others => '0') when plain = '1' else cross(61 downto 16);
      variance_sum <= resize(up_variances(0), 49) + beam_at_up_var when single_at(T_UP_VAR) = '1' else
                      resize(up_variances(0), 49) + up_variances(1);

      whole_variance <= resize(across_variances(0), 50) + across_variances(1);
    end if;
  end process;

  shares_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      shares_fit <= '0' & shares_fit(T_SHARES + 1 to T_UP - 1);
      if within(shares_wide(0), 17) and within(shares_wide(1), 17) then
        shares_fit(T_SHARES + 1) <= '1';
      end if;

      if exists_at(T_UP) = '0' or shares_fit(T_UP) = '0' then
        outcome_crossing <= NO_INTERSECTION;
      elsif not within(up, 25) then
        outcome_crossing <= INCONSISTENT;
      else
        outcome_crossing <= POINT;
      end if;
    end if;
  end process;

  up_near <= resize(up, 27);

  up_total_divisor          <= unsigned(up_total(48 downto 0));
  whole_variance_divisor    <= unsigned(whole_variance(48 downto 0));
  across_total_divisor      <= unsigned(across_total(48 downto 0));
  whole_late_divisor        <= unsigned(whole_late(48 downto 0));
  across_total_late_divisor <= unsigned(across_total_late(48 downto 0));

  -- The beam pulls the crossing

  gain_numerator <= shift_left(resize(covariance, 62), 16);
  gain_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 62, G_DIVISOR_WIDTH => 49, G_QUOTIENT_WIDTH => 20,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, numerator => gain_numerator, divisor => up_total_divisor, negative => open,
              magnitude => gain);
  gain_factor <= signed('0' & gain);
  up_at_total_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_TOTAL - T_UP)
    port map (clk => clk, enable => enable, value => up_near, later => up_at_total);
  up_at_gain_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_GAIN - T_TOTAL - 1)
    port map (clk => clk, enable => enable, value => up_turned, later => up_at_gain);
  pull_i : entity work.multiply
    generic map (G_A_WIDTH => 21, G_B_WIDTH => 27)
    port map (clk => clk, enable => enable, a => gain_factor, b => up_at_gain, addend => half(16, 48),
              product => pull_product);
  pull <= pull_product(46 downto 16);
  inverse_at_pull_i : entity work.delay
    generic map (G_WIDTH => 36, G_CLOCKS => T_GAIN + 2 - T_INVERSE - 1)
    port map (clk => clk, enable => enable, value => inverse_turned, later => inverse_at_pull);
  along_late_i : entity work.delay
    generic map (G_WIDTH => 30, G_CLOCKS => T_CORRECTED - 1 - T_ALONG)
    port map (clk => clk, enable => enable, value => along, later => along_late);
  shift_addend <= resize(along_late & LESS_28, 67);
  shift_i : entity work.multiply
    generic map (G_A_WIDTH => 31, G_B_WIDTH => 36)
    port map (clk => clk, enable => enable, a => pull, b => inverse_at_pull, addend => shift_addend,
              product => shift_product);
  corrected <= shift_product(66 downto 28);
  outcome_crossing_i : entity work.delay
    generic map (G_WIDTH => 3, G_CLOCKS => T_CORRECTED - T_UP - 1)
    port map (clk => clk, enable => enable, value => signed(outcome_crossing), later => outcome_late);

  correct_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      up_turned      <= -up_at_total when covariance(45) = '1' else up_at_total;
      inverse_turned <= inverse_slope when falls_at(T_INVERSE) = '1' else -inverse_slope;

      outcome_reach <= unsigned(outcome_late);
      if unsigned(outcome_late) = POINT and not in_reach(corrected) then
        outcome_reach <= OUT_OF_RANGE;
      end if;
    end if;
  end process;

  -- Standard deviation along the beam

  covariance_i : entity work.delay
    generic map (G_WIDTH => 46, G_CLOCKS => T_GAIN - T_TOTAL - 1)
    port map (clk => clk, enable => enable, value => covariance_size, later => covariance_late);
  variance_sum_i : entity work.delay
    generic map (G_WIDTH => 49, G_CLOCKS => T_GAIN + 1 - T_UP_VAR - 1)
    port map (clk => clk, enable => enable, value => variance_sum, later => variance_sum_late);
  remaining_addend <= resize(variance_sum_late & LESS_16, 67);
  remaining_i : entity work.multiply
    generic map (G_A_WIDTH => 21, G_B_WIDTH => 46)
    port map (clk => clk, enable => enable, a => gain_factor, b => covariance_late, addend => remaining_addend,
              product => remaining);
  root_i : entity work.sqrt
    generic map (G_WIDTH => 48, G_ROUND => true, G_BITS_PER_STAGE => FEW_BITS)
    port map (clk => clk, enable => enable, rst => '0', in_valid => '1', radicand => along_variance, out_valid => open,
              root => root);
  root_factor <= signed('0' & root);
  inverse_at_root_i : entity work.delay
    generic map (G_WIDTH => 36, G_CLOCKS => T_ROOT - T_INVERSE)
    port map (clk => clk, enable => enable, value => inverse_slope, later => inverse_at_root);
  -- The magnitude of the product with the signed inverse, rounded
  sigma_addend <= resize(LESS_28, 61) when falls_at(T_ROOT + 1) = '1' else half(28, 61);
  sigma_i : entity work.multiply
    generic map (G_A_WIDTH => 25, G_B_WIDTH => 36)
    port map (clk => clk, enable => enable, a => root_factor, b => inverse_at_root, addend => sigma_addend,
              product => sigma_product);
  sigma_fine <= sigma_product(60 downto 28);

  sigma_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      covariance_size <= covariance when covariance(45) = '1' else -covariance;
      along_variance  <= (others => '0') when remaining(66) = '1' else std_ulogic_vector(remaining(63 downto 16));
      sigma_here      <= saturate(round_shift(sigma_fine, 2), 32);
    end if;
  end process;

  sigma_late_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => T_POINT - T_ROOT - 3)
    port map (clk => clk, enable => enable, value => sigma_here, later => sigma);

  -- Across: mean of the rays by their variances

  second_variance <= across_variances(1) when rising_edge(clk) and enable = '1';
  share_numerator <= shift_left(resize(second_variance, 64), 16);
  share_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 64, G_DIVISOR_WIDTH => 49, G_QUOTIENT_WIDTH => 17, G_BITS_PER_STAGE => FEW_BITS)
    port map (clk => clk, enable => enable, numerator => share_numerator, divisor => whole_variance_divisor, negative => open,
              magnitude => share_quotient);
  across_share <= WHOLE when single_at(T_SHARE) = '1' else signed('0' & share_quotient);
  first_variance_i : entity work.delay
    generic map (G_WIDTH => 48, G_CLOCKS => T_SHARE - T_ACROSS_VAR)
    port map (clk => clk, enable => enable, value => across_variances(0), later => first_variance);
  mean_addend <= resize(beam_at_mean & HALF_16, 66);
  mean_i : entity work.multiply
    generic map (G_A_WIDTH => 48, G_B_WIDTH => 18)
    port map (clk => clk, enable => enable, a => first_variance, b => across_share, addend => mean_addend,
              product => mean_product);
  across_total <= mean_product(65 downto 16);
  share_late_i : entity work.delay
    generic map (G_WIDTH => 18, G_CLOCKS => T_DIFFERENCE - T_SHARE)
    port map (clk => clk, enable => enable, value => across_share, later => share_late);
  second_offset <= offsets(0) when single_at(T_OFFSETS) = '1' else offsets(1);
  second_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_ACROSS - 1 - T_OFFSETS)
    port map (clk => clk, enable => enable, value => second_offset(26 downto 0), later => second_late);
  mean_shift_addend <= resize(second_late & HALF_16, 45);
  mean_shift_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 18)
    port map (clk => clk, enable => enable, a => difference, b => share_late, addend => mean_shift_addend,
              product => mean_shift);
  across <= mean_shift(42 downto 16);
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

  ratio_up_numerator <= shift_left(resize(beam_at_total, 64), 16);
  ratio_up_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 64, G_DIVISOR_WIDTH => 49, G_QUOTIENT_WIDTH => 17, G_BITS_PER_STAGE => FEW_BITS)
    port map (clk => clk, enable => enable, numerator => ratio_up_numerator, divisor => up_total_divisor, negative => open,
              magnitude => ratio_up);
  ratio_up_factor <= signed('0' & ratio_up);
  up_at_ratio_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_RATIO_UP - T_TOTAL)
    port map (clk => clk, enable => enable, value => up_at_total, later => up_at_ratio);
  up_scaled_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 18)
    port map (clk => clk, enable => enable, a => up_at_ratio, b => ratio_up_factor, addend => half(16, 45),
              product => up_scaled);
  beam_up_here <= resize(up_scaled(44 downto 16), 33);
  beam_up_i : entity work.delay
    generic map (G_WIDTH => 33, G_CLOCKS => T_BEAM - T_RATIO_UP - 2)
    port map (clk => clk, enable => enable, value => beam_up_here, later => beam_up);

  ratio_across_numerator <= shift_left(resize(beam_at_across, 64), 16);
  ratio_across_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 64, G_DIVISOR_WIDTH => 49, G_QUOTIENT_WIDTH => 17, G_BITS_PER_STAGE => FEW_BITS)
    port map (clk => clk, enable => enable, numerator => ratio_across_numerator, divisor => across_total_divisor,
              negative => open,
              magnitude => ratio_across);
  ratio_across_factor <= signed('0' & ratio_across);
  ratio_across_late_i : entity work.delay
    generic map (G_WIDTH => 18, G_CLOCKS => T_SCALE - T_RATIO_ACROSS)
    port map (clk => clk, enable => enable, value => ratio_across_factor, later => ratio_across_late);
  across_at_scale_i : entity work.delay
    generic map (G_WIDTH => 27, G_CLOCKS => T_SCALE - T_ACROSS)
    port map (clk => clk, enable => enable, value => across, later => across_at_scale);
  across_scaled_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 18)
    port map (clk => clk, enable => enable, a => across_at_scale, b => ratio_across_late, addend => half(16, 45),
              product => across_scaled);
  beam_across <= resize(across_scaled(44 downto 16), 33);

  corrected_fit <= resize(corrected, 33);
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

  up_square_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 27)
    port map (clk => clk, enable => enable, a => up_near, b => up_near, product => up_square);
  up_square_late_i : entity work.delay
    generic map (G_WIDTH => 54, G_CLOCKS => T_TOTAL - T_UP - 2)
    port map (clk => clk, enable => enable, value => up_square, later => up_square_late);
  difference_square_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 27)
    port map (clk => clk, enable => enable, a => difference, b => difference, product => difference_square);
  across_square_i : entity work.multiply
    generic map (G_A_WIDTH => 27, G_B_WIDTH => 27)
    port map (clk => clk, enable => enable, a => across, b => across, product => across_square);

  up_numerator         <= shift_left(resize(up_square_late, 64), 12);
  difference_numerator <= shift_left(resize(difference_square, 64), 12);
  across_numerator     <= shift_left(resize(across_square, 64), 12);

  whole_i : entity work.delay
    generic map (G_WIDTH => 50, G_CLOCKS => T_DIFFERENCE + 2 - T_WHOLE)
    port map (clk => clk, enable => enable, value => whole_variance, later => whole_late);
  across_total_i : entity work.delay
    generic map (G_WIDTH => 50, G_CLOCKS => T_ACROSS + 2 - T_ACROSS_TOTAL)
    port map (clk => clk, enable => enable, value => across_total, later => across_total_late);

  chi2_up_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 64, G_DIVISOR_WIDTH => 49, G_QUOTIENT_WIDTH => 30, G_BITS_PER_STAGE => FEW_BITS)
    port map (clk => clk, enable => enable, numerator => up_numerator, divisor => up_total_divisor, negative => open,
              magnitude => chi2_up);
  chi2_difference_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 64, G_DIVISOR_WIDTH => 49, G_QUOTIENT_WIDTH => 30,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, numerator => difference_numerator, divisor => whole_late_divisor,
              negative => open,
              magnitude => chi2_difference);
  chi2_across_i : entity work.quotient
    generic map (G_NUMERATOR_WIDTH => 64, G_DIVISOR_WIDTH => 49, G_QUOTIENT_WIDTH => 30,
                 G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => enable, numerator => across_numerator, divisor => across_total_late_divisor,
              negative => open,
              magnitude => chi2_across);
  chi2_up_signed <= signed('0' & chi2_up);
  chi2_up_before_i : entity work.delay
    generic map (G_WIDTH => 31, G_CLOCKS => T_CHI - 2 - T_CHI_UP)
    port map (clk => clk, enable => enable, value => chi2_up_signed, later => chi2_up_before);
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

      -- The terms come one after the other
      chi2_up_late         <= chi2_up_before;
      chi2_difference_late <= chi2_difference;
      most_of_two          <= most - chi2_up_before;
      most_of_one          <= most_of_two - signed('0' & chi2_difference_late);
      chi2_of_two          <= resize(chi2_up_late, 33) + signed('0' & chi2_difference_late);

      -- A term at the end of its 30 bits makes the sum, in Q.14, saturate
      terms := chi2_of_two + signed('0' & chi2_across);
      chi2  <= saturate(terms & "00", 32);

      outcome <= unsigned(outcome_offsets_late);
      if unsigned(outcome_offsets_late) = POINT and signed('0' & chi2_across) > most_of_one then
        outcome <= INCONSISTENT;
      end if;
    end if;
  end process;

end architecture;
