-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Spots of two cameras to points.
--
-- Purpose     for every laser: rays of its spots, the pairs of rays, their fusion or average, the best point or the reason
--             why there is none. See doc/reconstructor.md for the streams and the calibration words
-- Latency     from a laser's last spot to its point, with P pairs and B = G_BITS_PER_STAGE:
--             weighted 64 + 4 * G_TERMS + P + ceil(22/B) + ceil(32/B) + ceil(33/B) + ceil(35/B) + ceil(37/B)
--             paper    62 + 4 * G_TERMS + P + ceil(22/B) + ceil(33/B) + ceil(35/B) + ceil(35/B) + ceil(37/B)
-- Throughput  one spot per clock, and one laser per P clocks. P: weighted n1 * n2, and n1 + n2 more if a camera alone may
--             do, but at least 1; paper 3
-- Resources   see doc/reconstructor.md
-- Twin        karst_core::reconstruct

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity reconstructor is
  generic (
    G_LASERS         : positive range 1 to 1024 := 12;  -- most lasers
    G_CANDIDATES     : positive range 1 to 7    := 4;   -- most spots of a laser in a camera
    G_TERMS          : positive range 2 to 8    := 8;   -- coefficients of each camera polynomial
    G_BITS_PER_STAGE : positive range 2 to 8    := 4    -- of roots and divisions. More: fewer clocks, but longer ones
  );
  port (
    clk           : in  std_ulogic;                       -- rising edge
    rst           : in  std_ulogic;                       -- synchronous, high: forgets what is under way
    -- Settings and calibration: constant from a laser's first spot to its point
    paper         : in  std_ulogic;                       -- the paper's method instead of the weighted one
    single_camera : in  std_ulogic;                       -- one camera alone may give a point
    range_min     : in  std_ulogic_vector(31 downto 0);   -- least distance along the beam, mm, Q18.14
    range_max     : in  std_ulogic_vector(31 downto 0);   -- greatest distance along the beam, mm, Q18.14
    chi2_max      : in  std_ulogic_vector(31 downto 0);   -- largest chi squared of a point, Q18.14
    write_valid   : in  std_ulogic;                       -- write a calibration word
    write_table   : in  std_ulogic_vector(1 downto 0);    -- to cameras, frames, places or uncertainties
    write_entry   : in  std_ulogic_vector(10 downto 0);   -- camera, 2 * laser + camera, laser or laser
    write_word    : in  std_ulogic_vector(4 downto 0);    -- place of the word in the entry
    write_data    : in  std_ulogic_vector(31 downto 0);   -- the word
    -- Spots, laser by laser
    s_axis_tvalid : in  std_ulogic;                       -- spot is there
    s_axis_tready : out std_ulogic;                       -- spot is taken if it is there
    s_axis_tdata  : in  std_ulogic_vector(191 downto 0);  -- spot
    s_axis_tlast  : in  std_ulogic;                       -- last of its laser
    -- Points, one per laser; they do not wait
    m_axis_tvalid : out std_ulogic;                       -- point is there
    m_axis_tdata  : out std_ulogic_vector(223 downto 0)   -- point, or the reason why there is none
  );
end entity;

architecture rtl of reconstructor is

  -- Clocks after the spot is taken
  constant T_SPOT : positive := 1;
  constant T_RAY  : positive := T_SPOT + camera_ray_latency(G_TERMS, G_BITS_PER_STAGE);
  constant T_LINE : positive := T_RAY + beam_ray_latency(G_BITS_PER_STAGE);

  -- Clocks after a pair
  constant T_CROSSING : positive := crossing_latency(G_BITS_PER_STAGE);
  constant T_BEAM     : positive := T_CROSSING + fuse_beam_latency(G_BITS_PER_STAGE);
  constant T_PLAIN    : positive := T_BEAM - 5;
  constant T_POINT    : positive := T_CROSSING + fuse_latency(G_BITS_PER_STAGE);
  constant T_AVERAGE  : positive := T_PLAIN + average_latency(G_BITS_PER_STAGE);
  constant T_END      : positive := maximum(T_POINT, T_AVERAGE + TO_RIG_LATENCY);

  constant CAMERA_WORDS : positive := CAMERA_POLYNOMIAL + 2 * G_TERMS;

  constant TABLE_CAMERAS       : std_ulogic_vector(1 downto 0) := "00";
  constant TABLE_FRAMES        : std_ulogic_vector(1 downto 0) := "01";
  constant TABLE_PLACES        : std_ulogic_vector(1 downto 0) := "10";
  constant TABLE_UNCERTAINTIES : std_ulogic_vector(1 downto 0) := "11";

  -- Variances of spots count up to 1 px**2
  constant MAX_VARIANCE : unsigned(31 downto 0) := to_unsigned(2 ** 24, 32);

  -- What goes along with a spot, and with a pair
  constant SPOT_WIDTH : positive := 29;
  constant PAIR_WIDTH : positive := 25;

  function entry_number(index : unsigned; entries : positive) return natural is
  begin
    -- Indices beyond the last entry are not used, but pass by in simulation
    if index >= entries then
      return 0;
    end if;
    return to_integer(index);
  end function;

  -- Calibration
  signal cameras_1, cameras_2 : words_t(0 to CAMERA_WORDS - 1);
  signal write_index          : unsigned(10 downto 0);
  signal write_place          : unsigned(4 downto 0);
  signal write_frames         : std_ulogic;
  signal write_places         : std_ulogic;
  signal write_uncertainties  : std_ulogic;
  signal frame                : words_t(0 to FRAME_WORDS - 1);
  signal place                : words_t(0 to PLACE_WORDS - 1);
  signal uncertainty          : words_t(0 to UNCERTAINTY_WORDS - 1);
  signal frame_entry          : natural range 0 to 2 * G_LASERS - 1;
  signal place_entry          : natural range 0 to G_LASERS - 1;
  signal uncertainty_entry    : natural range 0 to G_LASERS - 1;

  -- Spots
  type counts_t is array (0 to 1) of unsigned(3 downto 0);
  signal taken         : std_ulogic;
  signal counts        : counts_t;  -- spots of this laser so far
  signal busy          : unsigned(6 downto 0);  -- clocks until the pairs of the last laser are through
  signal spot_valid    : std_ulogic_vector(T_SPOT to T_LINE);
  signal position_x    : signed(31 downto 0);
  signal position_y    : signed(31 downto 0);
  signal variance      : signed(25 downto 0);
  signal variance_late : signed(25 downto 0);
  signal spot          : signed(SPOT_WIDTH - 1 downto 0);  -- camera, present, last, laser, radius
  signal spot_at_frame : signed(SPOT_WIDTH - 1 downto 0);
  signal spot_at_line  : signed(SPOT_WIDTH - 1 downto 0);

  -- Rays
  signal direction_x, direction_y, direction_z  : signed(31 downto 0);
  signal start                                  : signed(31 downto 0);
  signal direction_derivative, start_derivative : signed(31 downto 0);
  signal exists : std_ulogic;
  signal ray    : beam_ray_t;

  -- Pairs
  signal pair_valid       : std_ulogic_vector(0 to T_END);
  signal first, last      : std_ulogic;
  signal takes_part       : std_ulogic;
  signal single           : std_ulogic;
  signal laser            : unsigned(9 downto 0);
  signal reason           : outcome_t;
  signal used             : unsigned(1 downto 0);
  signal spot_1, spot_2   : unsigned(2 downto 0);
  signal ray_a, ray_b     : beam_ray_t;
  -- first, last, takes part, single, laser, reason, used, spot 1, spot 2
  signal pair                : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_before_fusion  : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_crossing    : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_plain       : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_before_beam    : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_before_average : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_point       : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_average     : signed(PAIR_WIDTH - 1 downto 0);
  signal rays_vector         : signed(2 * BEAM_RAY_WIDTH - 1 downto 0);
  signal rays_late           : signed(2 * BEAM_RAY_WIDTH - 1 downto 0);
  signal ray_a_late          : beam_ray_t;
  signal ray_b_late          : beam_ray_t;
  signal crosses             : std_ulogic;
  signal along               : signed(29 downto 0);
  signal inverse_slope       : signed(35 downto 0);
  signal origin_variance     : signed(43 downto 0);
  signal direction_variance  : signed(33 downto 0);
  signal plain_part          : std_ulogic;
  signal crosses_line        : signed(0 downto 0);
  signal crosses_late        : signed(0 downto 0);

  -- Points
  signal plain_along, plain_up, plain_across : signed(32 downto 0);
  signal fused_along, fused_up, fused_across : signed(32 downto 0);
  signal mean_along, mean_up, mean_across    : signed(32 downto 0);
  signal beam_along, beam_up, beam_across    : signed(32 downto 0);
  signal any_crossing      : std_ulogic;
  signal any_line          : signed(0 downto 0);
  signal any_late          : signed(0 downto 0);
  signal fused_outcome     : outcome_t;
  signal sigma, chi2       : signed(31 downto 0);
  signal in_range          : std_ulogic;
  signal distance          : signed(31 downto 0);
  signal position          : words_t(0 to 2);
  signal rig_point         : signed(128 downto 0);  -- in range, distance, X, Y, Z
  signal rig_point_late    : signed(128 downto 0);
  signal fused_final       : outcome_t;
  signal fused_payload     : signed(167 downto 0);
  signal best_valid        : std_ulogic;
  signal best_outcome      : outcome_t;
  signal best_along        : signed(31 downto 0);
  signal best_payload      : signed(167 downto 0);
  signal best_laser        : unsigned(9 downto 0);

begin

  -- Calibration

  write_index         <= unsigned(write_entry);
  write_place         <= unsigned(write_word);
  write_frames        <= write_valid when write_table = TABLE_FRAMES else '0';
  write_places        <= write_valid when write_table = TABLE_PLACES else '0';
  write_uncertainties <= write_valid when write_table = TABLE_UNCERTAINTIES else '0';

  cameras_p : process (clk)
  begin
    if rising_edge(clk) then
      if write_valid = '1' and write_table = TABLE_CAMERAS then
        for i in 0 to CAMERA_WORDS - 1 loop
          if write_place = i then
            if write_index(0) = '0' then
              cameras_1(i) <= signed(write_data);
            else
              cameras_2(i) <= signed(write_data);
            end if;
          end if;
        end loop;
      end if;
    end if;
  end process;

  frames_i : entity work.coefficient_ram
    generic map (G_WORDS => FRAME_WORDS, G_ENTRIES => 2 * G_LASERS)
    port map (clk => clk, write_valid => write_frames, write_entry => entry_number(write_index, 2 * G_LASERS),
              write_word => write_place, write_data => signed(write_data), read_entry => frame_entry, entry => frame);
  places_i : entity work.coefficient_ram
    generic map (G_WORDS => PLACE_WORDS, G_ENTRIES => G_LASERS)
    port map (clk => clk, write_valid => write_places, write_entry => entry_number(write_index, G_LASERS),
              write_word => write_place, write_data => signed(write_data), read_entry => place_entry, entry => place);
  uncertainties_i : entity work.coefficient_ram
    generic map (G_WORDS => UNCERTAINTY_WORDS, G_ENTRIES => G_LASERS)
    port map (clk => clk, write_valid => write_uncertainties, write_entry => entry_number(write_index, G_LASERS),
              write_word => write_place, write_data => signed(write_data), read_entry => uncertainty_entry,
              entry => uncertainty);

  -- Spots

  s_axis_tready <= '1' when busy = 0 or s_axis_tlast = '0' else '0';
  taken         <= s_axis_tvalid and s_axis_tready;

  spots_p : process (clk)
    variable present  : std_ulogic;
    variable now_have : counts_t;
    variable pairs    : unsigned(7 downto 0);

    -- Middle of two columns or rows in Q18.14
    function middle(least, greatest : std_ulogic_vector(15 downto 0)) return signed is
    begin
      return shift_left(resize(signed('0' & unsigned(least)), 32) + signed('0' & unsigned(greatest)), 13);
    end function;
  begin
    if rising_edge(clk) then
      now_have := counts;
      present  := '0';
      for camera in 0 to 1 loop
        -- Spots that are too many are passed over
        if s_axis_tdata(177) = '1' and (s_axis_tdata(176) = '1') = (camera = 1) and counts(camera) < G_CANDIDATES then
          present          := '1';
          now_have(camera) := counts(camera) + 1;
        end if;
      end loop;

      pairs := now_have(0) * now_have(1);
      if single_camera = '1' then
        pairs := pairs + now_have(0) + now_have(1);
      end if;
      if paper = '1' then
        pairs := to_unsigned(3, 8);
      end if;

      if busy > 0 then
        busy <= busy - 1;
      end if;
      if taken = '1' then
        counts <= now_have;
        if s_axis_tlast = '1' then
          counts <= (others => (others => '0'));
          busy   <= (others => '0');
          if pairs > 0 then
            busy <= resize(pairs - 1, 7);
          end if;
        end if;
      end if;

      if paper = '1' then
        position_x <= middle(s_axis_tdata(111 downto 96), s_axis_tdata(127 downto 112));
        position_y <= middle(s_axis_tdata(143 downto 128), s_axis_tdata(159 downto 144));
      else
        position_x <= signed(s_axis_tdata(31 downto 0));
        position_y <= signed(s_axis_tdata(63 downto 32));
      end if;
      if unsigned(s_axis_tdata(95 downto 64)) < MAX_VARIANCE then
        variance <= signed("00" & s_axis_tdata(87 downto 64));
      else
        variance <= signed(resize(MAX_VARIANCE, 26));
      end if;
      spot <= signed(s_axis_tdata(176) & present & s_axis_tlast & s_axis_tdata(187 downto 178)
                     & s_axis_tdata(175 downto 160));

      spot_valid(T_SPOT)               <= taken;
      spot_valid(T_SPOT + 1 to T_LINE) <= spot_valid(T_SPOT to T_LINE - 1);
      if rst = '1' then
        counts     <= (others => (others => '0'));
        busy       <= (others => '0');
        spot_valid <= (others => '0');
      end if;
    end if;
  end process;

  -- Rays

  camera_ray_i : entity work.camera_ray
    generic map (G_TERMS => G_TERMS, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, camera_1 => cameras_1, camera_2 => cameras_2, camera => spot(28), position_x => position_x,
              position_y => position_y, direction_x => direction_x, direction_y => direction_y,
              direction_z => direction_z, start => start, direction_derivative => direction_derivative,
              start_derivative => start_derivative);

  spot_at_frame_i : entity work.delay
    generic map (G_WIDTH => SPOT_WIDTH, G_CLOCKS => T_RAY - 1 - T_SPOT)
    port map (clk => clk, value => spot, later => spot_at_frame);
  frame_entry <= entry_number(unsigned(spot_at_frame(25 downto 16)) & spot_at_frame(28), 2 * G_LASERS);
  variance_i : entity work.delay
    generic map (G_WIDTH => 26, G_CLOCKS => T_RAY - T_SPOT)
    port map (clk => clk, value => variance, later => variance_late);

  beam_ray_i : entity work.beam_ray
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, frame => frame, direction_x => direction_x, direction_y => direction_y,
              direction_z => direction_z, start => start, direction_derivative => direction_derivative,
              start_derivative => start_derivative, variance => variance_late, exists => exists, ray => ray);

  spot_at_line_i : entity work.delay
    generic map (G_WIDTH => SPOT_WIDTH, G_CLOCKS => T_LINE - T_RAY + 1)
    port map (clk => clk, value => spot_at_frame, later => spot_at_line);

  -- Pairs

  pairing_i : entity work.pairing
    generic map (G_CANDIDATES => G_CANDIDATES)
    port map (clk => clk, rst => rst, paper => paper, single_camera => single_camera, in_valid => spot_valid(T_LINE),
              in_present => spot_at_line(27), in_camera => spot_at_line(28), in_last => spot_at_line(26),
              in_laser => unsigned(spot_at_line(25 downto 16)), in_radius => unsigned(spot_at_line(15 downto 0)),
              in_exists => exists, in_ray => ray, out_valid => pair_valid(0), out_first => first, out_last => last,
              out_takes_part => takes_part, out_single => single, out_laser => laser, out_reason => reason,
              out_used => used, out_spot_1 => spot_1, out_spot_2 => spot_2, out_ray_a => ray_a, out_ray_b => ray_b);

  valid_p : process (clk)
  begin
    if rising_edge(clk) then
      pair_valid(1 to T_END) <= pair_valid(0 to T_END - 1);
      if rst = '1' then
        pair_valid(1 to T_END) <= (others => '0');
      end if;
    end if;
  end process;

  crossing_i : entity work.crossing
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, single => single, up_slope_a => ray_a.up_slope, up_a => ray_a.up,
              up_slope_b => ray_b.up_slope, up_b => ray_b.up, exists => crosses, along => along,
              inverse_slope => inverse_slope);

  pair <= signed(first & last & takes_part & single & std_ulogic_vector(laser) & std_ulogic_vector(reason)
                 & std_ulogic_vector(used) & std_ulogic_vector(spot_1) & std_ulogic_vector(spot_2));
  pair_before_fusion_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_CROSSING - 1)
    port map (clk => clk, value => pair, later => pair_before_fusion);
  pair_at_crossing_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => 1)
    port map (clk => clk, value => pair_before_fusion, later => pair_at_crossing);
  rays_vector <= to_vector(ray_a) & to_vector(ray_b);
  rays_i : entity work.delay
    generic map (G_WIDTH => 2 * BEAM_RAY_WIDTH, G_CLOCKS => T_CROSSING)
    port map (clk => clk, value => rays_vector, later => rays_late);
  ray_a_late <= to_beam_ray(rays_late(2 * BEAM_RAY_WIDTH - 1 downto BEAM_RAY_WIDTH));
  ray_b_late <= to_beam_ray(rays_late(BEAM_RAY_WIDTH - 1 downto 0));

  uncertainty_entry  <= entry_number(unsigned(pair_before_fusion(20 downto 11)), G_LASERS);
  origin_variance    <= '0' & uncertainty(1)(10 downto 0) & uncertainty(0);
  direction_variance <= '0' & uncertainty(3)(0) & uncertainty(2);

  fuse_i : entity work.fuse
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, plain => paper, chi2_max => signed(chi2_max), single => pair_at_crossing(21),
              ray_a => ray_a_late, ray_b => ray_b_late, exists => crosses, along => along,
              inverse_slope => inverse_slope, origin_variance => origin_variance,
              direction_variance => direction_variance, plain_along => plain_along, plain_up => plain_up,
              plain_across => plain_across, beam_along => fused_along, beam_up => fused_up, beam_across => fused_across,
              outcome => fused_outcome, sigma => sigma, chi2 => chi2);

  -- The paper's average

  pair_at_plain_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_PLAIN - T_CROSSING)
    port map (clk => clk, value => pair_at_crossing, later => pair_at_plain);
  crosses_line(0) <= crosses;
  crosses_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_PLAIN - T_CROSSING)
    port map (clk => clk, value => crosses_line, later => crosses_late);
  plain_part <= pair_at_plain(22) and crosses_late(0);

  average_i : entity work.average
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, in_valid => pair_valid(T_PLAIN), first => pair_at_plain(24), takes_part => plain_part,
              along => plain_along, up => plain_up, across => plain_across, any => any_crossing,
              mean_along => mean_along, mean_up => mean_up, mean_across => mean_across);

  -- To the rig's frame: fused pairs or averages, at their own times

  pair_before_beam_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_BEAM - 1 - T_PLAIN)
    port map (clk => clk, value => pair_at_plain, later => pair_before_beam);
  pair_before_average_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_AVERAGE - 1 - T_PLAIN)
    port map (clk => clk, value => pair_at_plain, later => pair_before_average);
  place_entry <= entry_number(unsigned(pair_before_average(20 downto 11)), G_LASERS) when paper = '1' else
                 entry_number(unsigned(pair_before_beam(20 downto 11)), G_LASERS);
  beam_along  <= mean_along when paper = '1' else fused_along;
  beam_up     <= mean_up when paper = '1' else fused_up;
  beam_across <= mean_across when paper = '1' else fused_across;

  to_rig_i : entity work.to_rig
    port map (clk => clk, range_min => signed(range_min), range_max => signed(range_max), place => place,
              along => beam_along, up => beam_up, across => beam_across, in_range => in_range, distance => distance,
              position => position);

  -- The best of a laser's pairs

  pair_at_point_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_POINT - T_BEAM + 1)
    port map (clk => clk, value => pair_before_beam, later => pair_at_point);
  rig_point <= signed(in_range & std_ulogic_vector(distance) & std_ulogic_vector(position(0))
                      & std_ulogic_vector(position(1)) & std_ulogic_vector(position(2)));
  rig_point_i : entity work.delay
    generic map (G_WIDTH => 129, G_CLOCKS => T_POINT - T_BEAM - TO_RIG_LATENCY)
    port map (clk => clk, value => rig_point, later => rig_point_late);
  fused_final   <= OUT_OF_RANGE when fused_outcome = POINT and rig_point_late(128) = '0' else fused_outcome;
  fused_payload <= rig_point_late(95 downto 0) & sigma & chi2 & pair_at_point(7 downto 0);

  best_i : entity work.best_point
    generic map (G_PAYLOAD_WIDTH => 168)
    port map (clk => clk, rst => rst, in_valid => pair_valid(T_POINT), first => pair_at_point(24),
              last => pair_at_point(23), takes_part => pair_at_point(22), single => pair_at_point(21),
              reason => unsigned(pair_at_point(10 downto 8)), outcome => fused_final,
              along => rig_point_late(127 downto 96), payload => fused_payload, out_valid => best_valid,
              out_outcome => best_outcome, out_along => best_along, out_payload => best_payload);
  best_laser <= unsigned(pair_at_point(20 downto 11)) when rising_edge(clk);

  pair_at_average_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => TO_RIG_LATENCY + 1)
    port map (clk => clk, value => pair_before_average, later => pair_at_average);
  any_line(0) <= any_crossing;
  any_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => TO_RIG_LATENCY)
    port map (clk => clk, value => any_line, later => any_late);

  point_p : process (clk)
    variable result : outcome_t;
    variable number : unsigned(9 downto 0);
    variable spots  : signed(7 downto 0);
    variable point_data : signed(191 downto 0);
  begin
    if rising_edge(clk) then
      if paper = '1' then
        result := POINT;
        if any_late(0) = '0' then
          result := unsigned(pair_at_average(10 downto 8));
        elsif in_range = '0' then
          result := OUT_OF_RANGE;
        end if;
        number     := unsigned(pair_at_average(20 downto 11));
        spots      := pair_at_average(7 downto 0);
        point_data := to_signed(0, 64) & distance & position(2) & position(1) & position(0);
        m_axis_tvalid <= pair_valid(T_AVERAGE + TO_RIG_LATENCY) and pair_at_average(23);
      else
        result     := best_outcome;
        number     := best_laser;
        spots      := best_payload(7 downto 0);
        point_data := best_payload(39 downto 8) & best_payload(71 downto 40) & best_along & best_payload(103 downto 72)
                      & best_payload(135 downto 104) & best_payload(167 downto 136);
        m_axis_tvalid <= best_valid;
      end if;
      if result /= POINT then
        spots      := (others => '0');
        point_data := (others => '0');
      end if;
      m_axis_tdata <= (223 downto 213 => '0') & std_ulogic_vector(spots(2 downto 0)) & std_ulogic_vector(spots(5 downto 3))
                      & std_ulogic_vector(spots(7 downto 6)) & std_ulogic_vector(result) & std_ulogic_vector(number)
                      & std_ulogic_vector(point_data);
      if rst = '1' then
        m_axis_tvalid <= '0';
      end if;
    end if;
  end process;

end architecture;
