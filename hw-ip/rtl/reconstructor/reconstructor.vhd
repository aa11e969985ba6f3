-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Spots of two cameras to points.
--
-- Purpose     makes the ray of every spot when it is found; at the end of the frame, for every laser: the pairs of rays,
--             their fusion or average, the best point or the reason why there is none. See doc/reconstructor.md for the
--             streams and the calibration words
-- Latency     with s = ceil(17/B), B = G_BITS_PER_STAGE, and P pairs of a laser, from start to the first laser's point:
--             weighted 21 + P + s + max(30 + s, 23 + 2 s)
--             paper    49 + P + 2 s + ceil(35/(2 * B))
--             and the P of each laser after it later its point. Spots may come until start, which then counts as given
--             29 + 3 * G_TERMS + s + ceil(33/min(B, 2)) clocks after the last of them; by the paper's method not
--             before 2 + G_SLOT_BITS clocks after the last mask
-- Throughput  one spot per clock; one laser per P clocks. P: weighted n1 * n2, and n1 + n2 more if a camera alone may do;
--             paper 3 with spots of both cameras; at least 1
-- Resources   see doc/reconstructor.md
-- Twin        karst_core::reconstruct

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity reconstructor is
  generic (
    G_LASERS         : positive range 1 to 1024 := 12;  -- most lasers
    G_SLOT_BITS      : positive range 1 to 3    := 2;   -- most spots of a laser in a camera: 2 ** this
    G_TERMS          : positive range 2 to 8    := 8;   -- coefficients of each camera polynomial
    G_BITS_PER_STAGE : positive range 1 to 4    := 3    -- of divisions. More: fewer clocks, but longer ones
  );
  port (
    clk           : in  std_ulogic;                       -- rising edge
    rst           : in  std_ulogic;                       -- synchronous, high: forgets what is under way
    -- Settings and calibration: constant from a frame's first spot to its last point
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
    -- Spots, in any order, before start
    spot_valid    : in  std_ulogic;                                    -- spot is there
    spot_bank     : in  std_ulogic;                                    -- frames take turns
    spot_camera   : in  std_ulogic;                                    -- 0 for camera 1
    spot_laser    : in  std_ulogic_vector(9 downto 0);                 -- below G_LASERS, or the spot is passed over
    spot_slot     : in  std_ulogic_vector(G_SLOT_BITS - 1 downto 0);   -- a later spot replaces one in the same slot
    spot_data     : in  std_ulogic_vector(255 downto 0);               -- the detector's record
    -- Masks: which slots hold a spot, a laser at a time, after the camera's spots. Camera 1 in the low bit
    mask_valid    : in  std_ulogic_vector(1 downto 0);                 -- mask is there
    mask_bank     : in  std_ulogic_vector(1 downto 0);                 -- frames take turns
    mask_laser_1  : in  std_ulogic_vector(9 downto 0);                 -- below G_LASERS, or the mask is passed over
    mask_laser_2  : in  std_ulogic_vector(9 downto 0);
    mask_slots_1  : in  std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);  -- bit per slot
    mask_slots_2  : in  std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);
    -- Frames
    start         : in  std_ulogic;                       -- make the points of a bank, after its masks
    start_bank    : in  std_ulogic;                       -- which one
    lasers        : in  std_ulogic_vector(10 downto 0);   -- how many lasers, 1 to G_LASERS
    ready         : out std_ulogic;                       -- start is taken if it is there; no bank is read any more
    busy          : out std_ulogic;                       -- spots, pairs or points are under way
    -- Points, one per laser; they do not wait
    m_axis_tvalid : out std_ulogic;                       -- point is there
    m_axis_tdata  : out std_ulogic_vector(223 downto 0);  -- point, or the reason why there is none
    m_axis_tlast  : out std_ulogic                        -- of the frame's last laser
  );
end entity;

architecture rtl of reconstructor is

  -- Clocks after the spot is taken
  constant T_SPOT : positive := 1;
  constant T_RAY  : positive := T_SPOT + camera_ray_latency(G_TERMS, G_BITS_PER_STAGE);
  constant T_LINE : positive := T_RAY + beam_ray_latency(G_BITS_PER_STAGE);

  -- Clocks after a pair
  constant T_CROSSING : positive := crossing_latency(G_BITS_PER_STAGE);
  constant T_FUSION   : positive := T_CROSSING - 3;
  constant T_BEAM     : positive := T_FUSION + fuse_beam_latency(G_BITS_PER_STAGE);
  constant T_PLAIN    : positive := T_FUSION + fuse_plain_latency(G_BITS_PER_STAGE);
  constant T_POINT    : positive := T_FUSION + fuse_latency(G_BITS_PER_STAGE);
  constant T_AVERAGE  : positive := T_PLAIN + average_latency(G_BITS_PER_STAGE);
  constant T_MEAN     : positive := T_AVERAGE + TO_RIG_LATENCY;
  constant T_END      : positive := maximum(T_POINT, T_MEAN);

  constant CAMERA_WORDS : positive := CAMERA_POLYNOMIAL + 2 * G_TERMS;

  constant TABLE_CAMERAS       : std_ulogic_vector(1 downto 0) := "00";
  constant TABLE_FRAMES        : std_ulogic_vector(1 downto 0) := "01";
  constant TABLE_PLACES        : std_ulogic_vector(1 downto 0) := "10";
  constant TABLE_UNCERTAINTIES : std_ulogic_vector(1 downto 0) := "11";

  -- Variances of spots count up to 1 px**2
  constant MAX_VARIANCE : unsigned(31 downto 0) := to_unsigned(2 ** 24 - 1, 32);

  -- What goes along with a spot, and with a pair
  constant SPOT_WIDTH : positive := 12 + G_SLOT_BITS;
  constant PAIR_WIDTH : positive := 26;

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
  subtype slot_t   is unsigned(G_SLOT_BITS - 1 downto 0);
  subtype mask_t   is std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);
  type under_way_t is array (0 to 1) of unsigned(7 downto 0);
  signal taken         : std_ulogic;
  signal under_way     : under_way_t;  -- spots of each bank whose rays are not stored yet
  signal spot_at       : std_ulogic_vector(T_SPOT to T_LINE);
  signal spots_awake   : std_ulogic;   -- a spot is on its way to a ray
  signal position_x    : signed(31 downto 0);
  signal position_y    : signed(31 downto 0);
  signal variance      : signed(24 downto 0);
  signal variance_late : signed(24 downto 0);
  signal spot          : signed(SPOT_WIDTH - 1 downto 0);  -- bank, camera, laser, slot
  signal spot_at_frame : signed(SPOT_WIDTH - 1 downto 0);
  signal spot_at_end   : signed(SPOT_WIDTH - 1 downto 0);
  signal spot_at_line  : signed(SPOT_WIDTH - 1 downto 0);

  -- Rays
  signal direction_x, direction_y, direction_z  : signed(31 downto 0);
  signal axis_start                             : signed(31 downto 0);
  signal direction_derivative, start_derivative : signed(31 downto 0);
  signal exists       : std_ulogic;
  signal ray          : beam_ray_t;
  signal line_bank    : std_ulogic;
  signal line_laser   : unsigned(9 downto 0);
  signal line_slot    : slot_t;
  signal line_valid   : std_ulogic_vector(1 downto 0);

  -- Candidates
  signal candidate_valid : std_ulogic_vector(1 downto 0);
  signal masked          : std_ulogic_vector(1 downto 0);
  signal settling_1      : std_ulogic_vector(1 downto 0);
  signal settling_2      : std_ulogic_vector(1 downto 0);
  signal hold            : std_ulogic_vector(1 downto 0);
  signal read_bank       : std_ulogic;
  signal read_laser      : unsigned(9 downto 0);
  signal slots_1         : mask_t;
  signal slots_2         : mask_t;
  signal farthest_1      : slot_t;
  signal farthest_2      : slot_t;

  -- Pairs
  signal idle             : std_ulogic;
  signal walk_valid       : std_ulogic;
  signal walk_first       : std_ulogic;
  signal walk_last        : std_ulogic;
  signal walk_end         : std_ulogic;
  signal walk_bank        : std_ulogic;
  signal walk_laser       : unsigned(9 downto 0);
  signal walk_has         : std_ulogic_vector(1 downto 0);
  signal walk_used        : std_ulogic_vector(1 downto 0);
  signal walk_slot_1      : slot_t;
  signal walk_slot_2      : slot_t;
  signal walk_spot_1      : unsigned(2 downto 0);
  signal walk_spot_2      : unsigned(2 downto 0);
  signal read_valid       : std_ulogic;
  signal read_used        : std_ulogic_vector(1 downto 0);
  signal read_pair        : signed(PAIR_WIDTH - 1 downto 0);
  signal ray_1, ray_2     : beam_ray_t;
  signal exists_1         : std_ulogic;
  signal exists_2         : std_ulogic;
  signal pair_valid       : std_ulogic_vector(0 to T_END);
  signal pairs_awake      : std_ulogic;  -- a pair is on its way to a point
  signal awake_for        : natural range 0 to T_END;
  signal ray_a, ray_b     : beam_ray_t;
  -- end, first, last, takes part, single, laser, reason, used, spot 1, spot 2
  signal pair                : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_fusion      : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_before_crossing : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_crossing    : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_plain       : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_before_beam    : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_before_average : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_point       : signed(PAIR_WIDTH - 1 downto 0);
  signal pair_at_mean     : signed(PAIR_WIDTH - 1 downto 0);
  signal rays_vector         : signed(2 * BEAM_RAY_WIDTH - 1 downto 0);
  signal rays_late           : signed(2 * BEAM_RAY_WIDTH - 1 downto 0);
  signal ray_a_late          : beam_ray_t;
  signal ray_b_late          : beam_ray_t;
  signal crosses             : std_ulogic;
  signal falls               : std_ulogic;
  signal along               : signed(29 downto 0);
  signal slope_inverse       : unsigned(31 downto 0);
  signal slope_shift         : unsigned(3 downto 0);
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
  signal choice            : signed(PAIR_WIDTH - 1 downto 0);  -- a fused pair, or an average
  signal choice_valid      : std_ulogic;
  signal choice_outcome    : outcome_t;
  signal choice_along      : signed(31 downto 0);
  signal choice_payload    : signed(167 downto 0);
  signal best_valid        : std_ulogic;
  signal best_outcome      : outcome_t;
  signal best_along        : signed(31 downto 0);
  signal best_payload      : signed(167 downto 0);
  signal choice_late       : std_ulogic;
  signal choice_place      : signed(10 downto 0);
  signal best_place        : signed(10 downto 0);
  signal best_laser        : unsigned(9 downto 0);
  signal best_end          : std_ulogic;

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

  taken <= spot_valid when unsigned(spot_laser) < G_LASERS else '0';

  spots_p : process (clk)
    variable now_under_way : under_way_t;

    -- Middle of two columns or rows in Q18.14
    function middle(least, greatest : std_ulogic_vector(15 downto 0)) return signed is
    begin
      return shift_left(resize(signed('0' & unsigned(least)), 32) + signed('0' & unsigned(greatest)), 13);
    end function;
  begin
    if rising_edge(clk) then
      if paper = '1' then
        position_x <= middle(spot_data(175 downto 160), spot_data(191 downto 176));
        position_y <= middle(spot_data(207 downto 192), spot_data(223 downto 208));
      else
        position_x <= signed(spot_data(31 downto 0));
        position_y <= signed(spot_data(63 downto 32));
      end if;
      if unsigned(spot_data(95 downto 64)) < MAX_VARIANCE then
        variance <= signed('0' & spot_data(87 downto 64));
      else
        variance <= signed(resize(MAX_VARIANCE, 25));
      end if;
      spot <= signed(spot_bank & spot_camera & spot_laser & spot_slot);

      spot_at(T_SPOT)               <= taken;
      spot_at(T_SPOT + 1 to T_LINE) <= spot_at(T_SPOT to T_LINE - 1);

      now_under_way := under_way;
      for bank in 0 to 1 loop
        if taken = '1' and (spot_bank = '1') = (bank = 1) then
          now_under_way(bank) := now_under_way(bank) + 1;
        end if;
        -- A ray that is stored at the end of the next clock can be read
        if spot_at(T_LINE - 1) = '1' and (spot_at_end(SPOT_WIDTH - 1) = '1') = (bank = 1) then
          now_under_way(bank) := now_under_way(bank) - 1;
        end if;
      end loop;
      under_way   <= now_under_way;
      spots_awake <= '1' when now_under_way(0) /= 0 or now_under_way(1) /= 0 else '0';

      if rst = '1' then
        spot_at     <= (others => '0');
        under_way   <= (others => (others => '0'));
        spots_awake <= '0';
      end if;
    end if;
  end process;

  -- Rays

  camera_ray_i : entity work.camera_ray
    generic map (G_TERMS => G_TERMS, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => spots_awake, camera_1 => cameras_1, camera_2 => cameras_2,
              camera => spot(SPOT_WIDTH - 2), position_x => position_x,
              position_y => position_y, direction_x => direction_x, direction_y => direction_y,
              direction_z => direction_z, start => axis_start, direction_derivative => direction_derivative,
              start_derivative => start_derivative);

  spot_at_frame_i : entity work.delay
    generic map (G_WIDTH => SPOT_WIDTH, G_CLOCKS => T_RAY - 1 - T_SPOT)
    port map (clk => clk, enable => spots_awake, value => spot, later => spot_at_frame);
  frame_entry <= entry_number(unsigned(spot_at_frame(SPOT_WIDTH - 3 downto G_SLOT_BITS))
                              & spot_at_frame(SPOT_WIDTH - 2), 2 * G_LASERS);
  variance_i : entity work.delay
    generic map (G_WIDTH => 25, G_CLOCKS => T_RAY - T_SPOT)
    port map (clk => clk, enable => spots_awake, value => variance, later => variance_late);

  beam_ray_i : entity work.beam_ray
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => spots_awake, frame => frame, direction_x => direction_x, direction_y => direction_y,
              direction_z => direction_z, start => axis_start, direction_derivative => direction_derivative,
              start_derivative => start_derivative, variance => variance_late, exists => exists, ray => ray);

  spot_at_end_i : entity work.delay
    generic map (G_WIDTH => SPOT_WIDTH, G_CLOCKS => T_LINE - T_RAY)
    port map (clk => clk, enable => spots_awake, value => spot_at_frame, later => spot_at_end);
  spot_at_line_i : entity work.delay
    generic map (G_WIDTH => SPOT_WIDTH, G_CLOCKS => 1)
    port map (clk => clk, enable => spots_awake, value => spot_at_end, later => spot_at_line);
  line_bank     <= spot_at_line(SPOT_WIDTH - 1);
  line_laser    <= unsigned(spot_at_line(SPOT_WIDTH - 3 downto G_SLOT_BITS));
  line_slot     <= unsigned(spot_at_line(G_SLOT_BITS - 1 downto 0));
  line_valid(0) <= spot_at(T_LINE) and not spot_at_line(SPOT_WIDTH - 2);
  line_valid(1) <= spot_at(T_LINE) and spot_at_line(SPOT_WIDTH - 2);

  rays_1_i : entity work.ray_memory
    generic map (G_LASERS => G_LASERS, G_SLOT_BITS => G_SLOT_BITS)
    port map (clk => clk, write_valid => line_valid(0), write_bank => line_bank, write_laser => line_laser,
              write_slot => line_slot, write_exists => exists, write_ray => ray, read_bank => walk_bank,
              read_laser => walk_laser, read_slot => walk_slot_1, exists => exists_1, ray => ray_1);
  rays_2_i : entity work.ray_memory
    generic map (G_LASERS => G_LASERS, G_SLOT_BITS => G_SLOT_BITS)
    port map (clk => clk, write_valid => line_valid(1), write_bank => line_bank, write_laser => line_laser,
              write_slot => line_slot, write_exists => exists, write_ray => ray, read_bank => walk_bank,
              read_laser => walk_laser, read_slot => walk_slot_2, exists => exists_2, ray => ray_2);

  -- Pairs

  candidate_valid(0) <= taken and not spot_camera;
  candidate_valid(1) <= taken and spot_camera;
  masked(0) <= mask_valid(0) when unsigned(mask_laser_1) < G_LASERS else '0';
  masked(1) <= mask_valid(1) when unsigned(mask_laser_2) < G_LASERS else '0';

  candidates_1_i : entity work.candidates
    generic map (G_LASERS => G_LASERS, G_SLOT_BITS => G_SLOT_BITS)
    port map (clk => clk, rst => rst, spot_valid => candidate_valid(0), spot_bank => spot_bank,
              spot_laser => unsigned(spot_laser), spot_slot => unsigned(spot_slot),
              spot_radius => unsigned(spot_data(239 downto 224)), mask_valid => masked(0), mask_bank => mask_bank(0),
              mask_laser => unsigned(mask_laser_1), mask_slots => mask_slots_1, read_bank => read_bank,
              read_laser => read_laser, slots => slots_1, farthest => farthest_1, settling => settling_1);
  candidates_2_i : entity work.candidates
    generic map (G_LASERS => G_LASERS, G_SLOT_BITS => G_SLOT_BITS)
    port map (clk => clk, rst => rst, spot_valid => candidate_valid(1), spot_bank => spot_bank,
              spot_laser => unsigned(spot_laser), spot_slot => unsigned(spot_slot),
              spot_radius => unsigned(spot_data(239 downto 224)), mask_valid => masked(1), mask_bank => mask_bank(1),
              mask_laser => unsigned(mask_laser_2), mask_slots => mask_slots_2, read_bank => read_bank,
              read_laser => read_laser, slots => slots_2, farthest => farthest_2, settling => settling_2);

  hold_g : for bank in 0 to 1 generate
    hold(bank) <= '1' when under_way(bank) /= 0 or (paper = '1' and (settling_1(bank) or settling_2(bank)) = '1') else '0';
  end generate;

  pairing_i : entity work.pairing
    generic map (G_SLOT_BITS => G_SLOT_BITS)
    port map (clk => clk, rst => rst, paper => paper, single_camera => single_camera, start => start,
              start_bank => start_bank, lasers => unsigned(lasers), ready => idle, hold => hold, read_bank => read_bank,
              read_laser => read_laser, slots_1 => slots_1, slots_2 => slots_2, farthest_1 => farthest_1,
              farthest_2 => farthest_2, out_valid => walk_valid, out_first => walk_first, out_last => walk_last,
              out_end => walk_end, out_bank => walk_bank, out_laser => walk_laser, out_has => walk_has,
              out_used => walk_used, out_slot_1 => walk_slot_1, out_slot_2 => walk_slot_2, out_spot_1 => walk_spot_1,
              out_spot_2 => walk_spot_2);

  ready <= idle;
  busy  <= '1' when idle = '0' or read_valid = '1' or (or pair_valid) = '1' or choice_late = '1' or best_valid = '1'
                    or under_way(0) /= 0 or under_way(1) /= 0 else '0';

  pairs_p : process (clk)
    variable reason : outcome_t;
    variable used   : std_ulogic_vector(1 downto 0);
    variable single : std_ulogic;
    variable none   : beam_ray_t;
  begin
    if rising_edge(clk) then
      -- While the rays are read
      reason := ONE_CAMERA;
      if walk_has = "00" then
        reason := NO_SPOT;
      elsif walk_has = "11" or paper = '1' then
        reason := NO_INTERSECTION;
      end if;
      used   := walk_has when paper = '1' else walk_used;
      single := '0' when walk_used = "11" else '1';
      read_pair  <= signed(walk_end & walk_first & walk_last & '0' & single & std_ulogic_vector(walk_laser)
                           & std_ulogic_vector(reason) & used & (std_ulogic_vector(walk_spot_1) and used(0))
                           & (std_ulogic_vector(walk_spot_2) and used(1)));
      read_used  <= walk_used;
      read_valid <= walk_valid;

      none     := to_beam_ray(to_signed(0, BEAM_RAY_WIDTH));
      pair     <= read_pair;
      pair(22) <= (read_used(0) or read_used(1)) and (exists_1 or not read_used(0)) and (exists_2 or not read_used(1));
      ray_a    <= ray_1 when read_used(0) = '1' else ray_2;
      ray_b    <= ray_2 when read_used = "11" else none;

      pair_valid(0)          <= read_valid;
      pair_valid(1 to T_END) <= pair_valid(0 to T_END - 1);

      if read_valid = '1' then
        pairs_awake <= '1';
        awake_for   <= T_END;
      elsif awake_for /= 0 then
        awake_for   <= awake_for - 1;
      else
        pairs_awake <= '0';
      end if;

      if rst = '1' then
        read_valid  <= '0';
        pair_valid  <= (others => '0');
        pairs_awake <= '0';
        awake_for   <= 0;
      end if;
    end if;
  end process;

  crossing_i : entity work.crossing
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => pairs_awake, single => pair(21), up_slope_a => ray_a.up_slope, up_a => ray_a.up,
              up_slope_b => ray_b.up_slope, up_b => ray_b.up, exists => crosses, along => along,
              falls => falls, inverse => slope_inverse, shift => slope_shift);

  pair_at_fusion_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_FUSION)
    port map (clk => clk, enable => pairs_awake, value => pair, later => pair_at_fusion);
  pair_before_crossing_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_CROSSING - 1 - T_FUSION)
    port map (clk => clk, enable => pairs_awake, value => pair_at_fusion, later => pair_before_crossing);
  pair_at_crossing_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => 1)
    port map (clk => clk, enable => pairs_awake, value => pair_before_crossing, later => pair_at_crossing);
  rays_vector <= to_vector(ray_a) & to_vector(ray_b);
  rays_i : entity work.delay
    generic map (G_WIDTH => 2 * BEAM_RAY_WIDTH, G_CLOCKS => T_FUSION)
    port map (clk => clk, enable => pairs_awake, value => rays_vector, later => rays_late);
  ray_a_late <= to_beam_ray(rays_late(2 * BEAM_RAY_WIDTH - 1 downto BEAM_RAY_WIDTH));
  ray_b_late <= to_beam_ray(rays_late(BEAM_RAY_WIDTH - 1 downto 0));

  uncertainty_entry  <= entry_number(unsigned(pair_before_crossing(20 downto 11)), G_LASERS);
  origin_variance    <= '0' & uncertainty(1)(10 downto 0) & uncertainty(0);
  direction_variance <= '0' & uncertainty(3)(0) & uncertainty(2);

  fuse_i : entity work.fuse
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => pairs_awake, plain => paper, chi2_max => signed(chi2_max), single => pair_at_fusion(21),
              falls => falls, ray_a => ray_a_late, ray_b => ray_b_late, exists => crosses, along => along,
              inverse => slope_inverse, shift => slope_shift, origin_variance => origin_variance,
              direction_variance => direction_variance, plain_along => plain_along, plain_up => plain_up,
              plain_across => plain_across, beam_along => fused_along, beam_up => fused_up, beam_across => fused_across,
              outcome => fused_outcome, sigma => sigma, chi2 => chi2);

  -- The paper's average

  pair_at_plain_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_PLAIN - T_CROSSING)
    port map (clk => clk, enable => pairs_awake, value => pair_at_crossing, later => pair_at_plain);
  crosses_line(0) <= crosses;
  crosses_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => T_PLAIN - T_CROSSING)
    port map (clk => clk, enable => pairs_awake, value => crosses_line, later => crosses_late);
  plain_part <= pair_at_plain(22) and crosses_late(0);

  average_i : entity work.average
    generic map (G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (clk => clk, enable => pairs_awake, in_valid => pair_valid(T_PLAIN), first => pair_at_plain(24),
              takes_part => plain_part,
              along => plain_along, up => plain_up, across => plain_across, any => any_crossing,
              mean_along => mean_along, mean_up => mean_up, mean_across => mean_across);

  -- To the rig's frame: fused pairs or averages, at their own times

  pair_before_beam_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_BEAM - 1 - T_PLAIN)
    port map (clk => clk, enable => pairs_awake, value => pair_at_plain, later => pair_before_beam);
  pair_before_average_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_AVERAGE - 1 - T_PLAIN)
    port map (clk => clk, enable => pairs_awake, value => pair_at_plain, later => pair_before_average);
  place_entry <= entry_number(unsigned(pair_before_average(20 downto 11)), G_LASERS) when paper = '1' else
                 entry_number(unsigned(pair_before_beam(20 downto 11)), G_LASERS);
  beam_along  <= mean_along when paper = '1' else fused_along;
  beam_up     <= mean_up when paper = '1' else fused_up;
  beam_across <= mean_across when paper = '1' else fused_across;

  to_rig_i : entity work.to_rig
    port map (clk => clk, enable => pairs_awake, range_min => signed(range_min), range_max => signed(range_max),
              place => place,
              along => beam_along, up => beam_up, across => beam_across, in_range => in_range, distance => distance,
              position => position);

  -- The best of a laser's pairs

  pair_at_point_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => T_POINT - T_BEAM + 1)
    port map (clk => clk, enable => pairs_awake, value => pair_before_beam, later => pair_at_point);
  rig_point <= signed(in_range & std_ulogic_vector(distance) & std_ulogic_vector(position(0))
                      & std_ulogic_vector(position(1)) & std_ulogic_vector(position(2)));
  rig_point_i : entity work.delay
    generic map (G_WIDTH => 129, G_CLOCKS => T_POINT - T_BEAM - TO_RIG_LATENCY)
    port map (clk => clk, enable => pairs_awake, value => rig_point, later => rig_point_late);
  any_line(0) <= any_crossing;
  any_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => TO_RIG_LATENCY)
    port map (clk => clk, enable => pairs_awake, value => any_line, later => any_late);
  pair_at_mean_i : entity work.delay
    generic map (G_WIDTH => PAIR_WIDTH, G_CLOCKS => TO_RIG_LATENCY + 1)
    port map (clk => clk, enable => pairs_awake, value => pair_before_average, later => pair_at_mean);

  -- An average is the only point of its laser
  choice_p : process (all)
  begin
    if paper = '1' then
      choice         <= pair_at_mean;
      choice(24)     <= '1';
      choice(22)     <= any_late(0);
      choice(21)     <= '0';
      choice_valid   <= pair_valid(T_MEAN) and pair_at_mean(23);
      choice_outcome <= POINT;
      if in_range = '0' then
        choice_outcome <= OUT_OF_RANGE;
      end if;
      choice_along   <= distance;
      choice_payload <= position(0) & position(1) & position(2) & to_signed(0, 64) & pair_at_mean(7 downto 0);
    else
      choice         <= pair_at_point;
      choice_valid   <= pair_valid(T_POINT);
      choice_outcome <= fused_outcome;
      if fused_outcome = POINT and rig_point_late(128) = '0' then
        choice_outcome <= OUT_OF_RANGE;
      end if;
      choice_along   <= rig_point_late(127 downto 96);
      choice_payload <= rig_point_late(95 downto 0) & sigma & chi2 & pair_at_point(7 downto 0);
    end if;
  end process;

  best_i : entity work.best_point
    generic map (G_PAYLOAD_WIDTH => 168)
    port map (clk => clk, rst => rst, in_valid => choice_valid, first => choice(24), last => choice(23),
              takes_part => choice(22), single => choice(21), reason => unsigned(choice(10 downto 8)),
              outcome => choice_outcome, along => choice_along, payload => choice_payload, out_valid => best_valid,
              out_outcome => best_outcome, out_along => best_along, out_payload => best_payload);

  -- It is being compared
  choice_late  <= choice_valid when rising_edge(clk);
  choice_place <= signed(choice(25) & choice(20 downto 11));

  place_i : entity work.delay
    generic map (G_WIDTH => 11, G_CLOCKS => 2)
    port map (clk => clk, value => choice_place, later => best_place);

  best_laser <= unsigned(best_place(9 downto 0));
  best_end   <= best_place(10);

  m_axis_tvalid <= best_valid;
  m_axis_tlast  <= best_end;

  point_p : process (all)
    variable spots      : signed(7 downto 0);
    variable point_data : signed(191 downto 0);
  begin
    spots      := best_payload(7 downto 0);
    point_data := best_payload(39 downto 8) & best_payload(71 downto 40) & best_along & best_payload(103 downto 72)
                  & best_payload(135 downto 104) & best_payload(167 downto 136);
    if best_outcome /= POINT then
      spots      := (others => '0');
      point_data := (others => '0');
    end if;
    m_axis_tdata <= (223 downto 213 => '0') & std_ulogic_vector(spots(2 downto 0)) & std_ulogic_vector(spots(5 downto 3))
                    & std_ulogic_vector(spots(7 downto 6)) & std_ulogic_vector(best_outcome)
                    & std_ulogic_vector(best_laser) & std_ulogic_vector(point_data);
  end process;

end architecture;
