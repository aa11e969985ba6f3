-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The whole IP: two cameras in, points out.
--
-- Purpose     finds the laser spots in two video streams, makes points of the pairs of frames, and holds them for software
-- Consists of frame_gate, a detector and its frame_tags per camera, reconstructor, frame_results, registers
-- Latency     hw-ip/doc/top.md
-- Throughput  G_PPC pixels per clock and camera
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_regs::model::Model

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity karst_top is
  generic (
    G_PPC            : positive range 1 to 8 := 1;     -- pixels per clock: 1, 2, 4 or 8
    G_X_BITS         : positive range 7 to 11 := 10;   -- widest image: 2 ** this
    G_Y_BITS         : positive range 1 to 11 := 10;   -- highest image: 2 ** this, not above the widest
    G_LASERS         : positive range 2 to 720 := 12;  -- most lasers
    G_SLOT_BITS      : positive range 1 to 2 := 2;     -- most spots per laser and camera: 2 ** this
    G_BITS_PER_STAGE : positive range 1 to 4 := 3      -- as reconstructor
  );
  port (
    clk              : in  std_ulogic;                                  -- rising edge
    rst              : in  std_ulogic;                                  -- synchronous, high: forgets everything

    -- Pixels of camera 1: AXI4-Stream Video
    s_axis_1_tvalid  : in  std_ulogic;                                  -- beat is there
    s_axis_1_tready  : out std_ulogic;                                  -- it is taken if it is there
    s_axis_1_tdata   : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);  -- pixels, the leftmost in the low bits: R, B, G from
                                                                        -- the high byte down
    s_axis_1_tuser   : in  std_ulogic;                                  -- first beat of a frame
    s_axis_1_tlast   : in  std_ulogic;                                  -- last beat of a row

    -- Pixels of camera 2
    s_axis_2_tvalid  : in  std_ulogic;                                  -- as camera 1
    s_axis_2_tready  : out std_ulogic;
    s_axis_2_tdata   : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);
    s_axis_2_tuser   : in  std_ulogic;
    s_axis_2_tlast   : in  std_ulogic;

    -- Registers: AXI4-Lite, 1 MiB
    s_axi_awvalid    : in  std_ulogic;                                  -- write address is there
    s_axi_awready    : out std_ulogic;                                  -- it is taken if it is there
    s_axi_awaddr     : in  std_ulogic_vector(19 downto 0);              -- byte address
    s_axi_wvalid     : in  std_ulogic;                                  -- write data are there
    s_axi_wready     : out std_ulogic;                                  -- they are taken if they are there
    s_axi_wdata      : in  std_ulogic_vector(31 downto 0);              -- the data
    s_axi_wstrb      : in  std_ulogic_vector(3 downto 0);               -- bytes to be written
    s_axi_bvalid     : out std_ulogic;                                  -- write response is there
    s_axi_bready     : in  std_ulogic;                                  -- it is taken if it is there
    s_axi_bresp      : out std_ulogic_vector(1 downto 0);               -- OKAY
    s_axi_arvalid    : in  std_ulogic;                                  -- read address is there
    s_axi_arready    : out std_ulogic;                                  -- it is taken if it is there
    s_axi_araddr     : in  std_ulogic_vector(19 downto 0);              -- byte address
    s_axi_rvalid     : out std_ulogic;                                  -- read response is there
    s_axi_rready     : in  std_ulogic;                                  -- it is taken if it is there
    s_axi_rdata      : out std_ulogic_vector(31 downto 0);              -- the data
    s_axi_rresp      : out std_ulogic_vector(1 downto 0);               -- OKAY

    interrupt        : out std_ulogic                                   -- an enabled event has come and was not cleared
  );
end entity;

architecture rtl of karst_top is

  function bits_for(count : positive) return natural is
    variable bits : natural := 0;
  begin
    while 2 ** bits < count loop
      bits := bits + 1;
    end loop;
    return bits;
  end function;

  constant LASER_BITS : positive := bits_for(G_LASERS);
  constant SLOTS      : positive := 2 ** G_SLOT_BITS;
  constant DATA_BITS  : positive := 24 * G_PPC;

  -- By camera: index 0 is camera 1
  subtype flags_t is std_ulogic_vector(1 downto 0);
  type heights_t is array (0 to 1) of std_ulogic_vector(G_Y_BITS downto 0);
  type records_t is array (0 to 1) of std_ulogic_vector(255 downto 0);
  type slots_t is array (0 to 1) of std_ulogic_vector(G_SLOT_BITS - 1 downto 0);
  type masks_t is array (0 to 1) of std_ulogic_vector(SLOTS - 1 downto 0);
  type lasers_t is array (0 to 1) of std_ulogic_vector(9 downto 0);

  signal frame_rst   : std_ulogic;  -- forgets the frames under way
  signal frame_reset : std_ulogic;
  signal configured  : std_ulogic;
  signal enable      : std_ulogic;
  signal committing  : std_ulogic;
  signal frame_idle  : std_ulogic;
  signal cycles      : std_ulogic_vector(31 downto 0);
  signal commits     : std_ulogic_vector(31 downto 0);

  signal load_valid   : std_ulogic;
  signal load_address : std_ulogic_vector(15 downto 0);
  signal load_data    : std_ulogic_vector(31 downto 0);
  signal heights      : heights_t;

  signal pixels_valid  : flags_t;
  signal pixels_ready  : flags_t;
  signal pixels_data   : std_ulogic_vector(2 * DATA_BITS - 1 downto 0);
  signal pixels_user   : flags_t;
  signal pixels_last   : flags_t;
  signal gated_valid   : flags_t;
  signal gated_ready   : flags_t;
  signal gated_data    : std_ulogic_vector(2 * DATA_BITS - 1 downto 0);
  signal gated_user    : flags_t;
  signal gated_last    : flags_t;
  signal gated_void    : flags_t;
  signal gate_idle     : std_ulogic;
  signal in_frame      : flags_t;
  signal start         : flags_t;
  signal start_bank    : flags_t;
  signal start_first   : std_ulogic;
  signal first_bank    : std_ulogic;
  signal finish        : flags_t;
  signal finish_bank   : flags_t;
  signal finish_paired : flags_t;
  signal pair_done     : std_ulogic;

  signal room          : flags_t;
  signal empty         : flags_t;
  signal mask_bank     : flags_t;
  signal mask_paired   : flags_t;
  signal record_bank   : flags_t;
  signal record_paired : flags_t;
  signal recorded      : flags_t;

  signal record_valid : flags_t;
  signal record_ready : flags_t;
  signal record_data  : records_t;
  signal record_last  : flags_t;
  signal early_valid  : flags_t;
  signal early_slot   : slots_t;
  signal early_data   : records_t;
  signal mask_valid   : flags_t;
  signal mask_laser   : lasers_t;
  signal mask_slots   : masks_t;
  signal mask_last    : flags_t;
  signal masked       : flags_t;

  signal later_valid : std_ulogic;  -- the spot of camera 2 comes a clock later, or two
  signal later_bank  : std_ulogic;
  signal later_slot  : std_ulogic_vector(G_SLOT_BITS - 1 downto 0);
  signal later_data  : std_ulogic_vector(255 downto 0);
  signal spot_valid  : std_ulogic;
  signal spot_bank   : std_ulogic;
  signal spot_camera : std_ulogic;
  signal spot_laser  : std_ulogic_vector(9 downto 0);
  signal spot_slot   : std_ulogic_vector(G_SLOT_BITS - 1 downto 0);
  signal spot_data   : std_ulogic_vector(255 downto 0);

  signal lasers        : std_ulogic_vector(10 downto 0);
  signal paper         : std_ulogic;
  signal single_camera : std_ulogic;
  signal range_min     : std_ulogic_vector(31 downto 0);
  signal range_max     : std_ulogic_vector(31 downto 0);
  signal chi2_max      : std_ulogic_vector(31 downto 0);
  signal write_valid   : std_ulogic;
  signal write_table   : std_ulogic_vector(1 downto 0);
  signal write_entry   : std_ulogic_vector(10 downto 0);
  signal write_word    : std_ulogic_vector(4 downto 0);
  signal write_data    : std_ulogic_vector(31 downto 0);

  signal make_points : std_ulogic;
  signal make_bank   : std_ulogic;
  signal make_ready  : std_ulogic;
  signal make_busy   : std_ulogic;
  signal point_valid : std_ulogic;
  signal point_data  : std_ulogic_vector(223 downto 0);
  signal point_last  : std_ulogic;

  signal result_write  : std_ulogic;
  signal result_record : std_ulogic_vector(11 downto 0);
  signal result_data   : std_ulogic_vector(255 downto 0);
  signal spot_write    : flags_t;
  signal spot_1_record : std_ulogic_vector(11 downto 0);
  signal spot_2_record : std_ulogic_vector(11 downto 0);
  signal results_done  : std_ulogic;

  signal event_short_row : flags_t;
  signal event_long_row  : flags_t;
  signal event_truncated : flags_t;
  signal event_stray_row : flags_t;
  signal event_overflow  : flags_t;
  signal event_stalled   : flags_t;
  signal event_unpaired  : std_ulogic;
  signal event_skipped   : std_ulogic;
  signal stalls          : flags_t;
  signal stalled         : flags_t;  -- a clock ago

begin

  frame_rst  <= rst or frame_reset;
  frame_idle <= gate_idle and empty(0) and empty(1) and not make_busy;

  -- Frames

  pixels_valid    <= s_axis_2_tvalid & s_axis_1_tvalid;
  pixels_data     <= s_axis_2_tdata & s_axis_1_tdata;
  pixels_user     <= s_axis_2_tuser & s_axis_1_tuser;
  pixels_last     <= s_axis_2_tlast & s_axis_1_tlast;
  s_axis_1_tready <= pixels_ready(0);
  s_axis_2_tready <= pixels_ready(1);

  gate_i : entity work.frame_gate
    generic map (G_DATA_BITS => DATA_BITS, G_Y_BITS => G_Y_BITS)
    port map (
      clk => clk, rst => rst, configured => configured, enable => enable, committing => committing,
      frame_reset => frame_reset, height_1 => heights(0), height_2 => heights(1), room => room, pair_done => pair_done,
      s_axis_tvalid => pixels_valid, s_axis_tready => pixels_ready, s_axis_tdata => pixels_data,
      s_axis_tuser => pixels_user, s_axis_tlast => pixels_last,
      m_axis_tvalid => gated_valid, m_axis_tready => gated_ready, m_axis_tdata => gated_data,
      m_axis_tuser => gated_user, m_axis_tlast => gated_last, m_axis_void => gated_void,
      start => start, start_bank => start_bank, start_first => start_first, finish => finish,
      finish_bank => finish_bank, finish_paired => finish_paired, in_frame => in_frame, idle => gate_idle,
      event_stray => event_stray_row, event_unpaired => event_unpaired, event_skipped => event_skipped);

  cameras_g : for camera in 0 to 1 generate
    signal cfg_width             : std_ulogic_vector(G_X_BITS downto 0);
    signal cfg_height            : std_ulogic_vector(G_Y_BITS downto 0);
    signal cfg_green_min_0       : std_ulogic_vector(7 downto 0);
    signal cfg_green_min_1       : std_ulogic_vector(7 downto 0);
    signal cfg_excess_min_0      : std_ulogic_vector(8 downto 0);
    signal cfg_excess_min_1      : std_ulogic_vector(8 downto 0);
    signal cfg_saturation_min    : std_ulogic_vector(7 downto 0);
    signal cfg_clip_min          : std_ulogic_vector(7 downto 0);
    signal cfg_clipped_weight    : std_ulogic_vector(8 downto 0);
    signal cfg_centre_x          : std_ulogic_vector(G_X_BITS + 4 downto 0);
    signal cfg_centre_y          : std_ulogic_vector(G_Y_BITS + 4 downto 0);
    signal cfg_mirror_radius     : std_ulogic_vector(15 downto 0);
    signal cfg_inner_radius      : std_ulogic_vector(15 downto 0);
    signal cfg_cluster_gap       : std_ulogic_vector(10 downto 0);
    signal cfg_min_pixels        : std_ulogic_vector(15 downto 0);
    signal cfg_clockwise         : std_ulogic;
    signal cfg_lasers            : std_ulogic_vector(LASER_BITS downto 0);
    signal cfg_first_edge        : std_ulogic_vector(15 downto 0);
    signal cfg_sector_half_width : std_ulogic_vector(15 downto 0);
    signal cfg_noise_floor       : std_ulogic_vector(31 downto 0);
    signal cfg_noise             : std_ulogic_vector(31 downto 0);
    signal cfg_azimuth_write     : std_ulogic;
    signal cfg_azimuth_laser     : std_ulogic_vector(LASER_BITS - 1 downto 0);
    signal cfg_azimuth           : std_ulogic_vector(15 downto 0);
  begin

    settings_i : entity work.detector_settings
      generic map (G_CAMERA => camera, G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASER_BITS => LASER_BITS)
      port map (
        clk => clk, load_valid => load_valid, load_address => load_address, load_data => load_data,
        cfg_width => cfg_width, cfg_height => cfg_height, cfg_green_min_0 => cfg_green_min_0,
        cfg_green_min_1 => cfg_green_min_1, cfg_excess_min_0 => cfg_excess_min_0,
        cfg_excess_min_1 => cfg_excess_min_1, cfg_saturation_min => cfg_saturation_min, cfg_clip_min => cfg_clip_min,
        cfg_clipped_weight => cfg_clipped_weight, cfg_centre_x => cfg_centre_x, cfg_centre_y => cfg_centre_y,
        cfg_mirror_radius => cfg_mirror_radius, cfg_inner_radius => cfg_inner_radius,
        cfg_cluster_gap => cfg_cluster_gap, cfg_min_pixels => cfg_min_pixels, cfg_clockwise => cfg_clockwise,
        cfg_lasers => cfg_lasers, cfg_first_edge => cfg_first_edge, cfg_sector_half_width => cfg_sector_half_width,
        cfg_noise_floor => cfg_noise_floor, cfg_noise => cfg_noise, cfg_azimuth_write => cfg_azimuth_write,
        cfg_azimuth_laser => cfg_azimuth_laser, cfg_azimuth => cfg_azimuth);

    heights(camera) <= cfg_height;

    tags_i : entity work.frame_tags
      port map (
        clk => clk, rst => frame_rst, start => start(camera), start_bank => start_bank(camera),
        finish => finish(camera), finish_paired => finish_paired(camera), masked => masked(camera),
        recorded => recorded(camera), room => room(camera), empty => empty(camera), mask_bank => mask_bank(camera),
        mask_paired => mask_paired(camera), record_bank => record_bank(camera),
        record_paired => record_paired(camera));

    detector_i : entity work.detector
      generic map (
        G_PPC => G_PPC, G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASER_BITS => LASER_BITS,
        G_SLOT_BITS => G_SLOT_BITS)
      port map (
        clk => clk, rst => frame_rst,
        cfg_width => cfg_width, cfg_height => cfg_height, cfg_green_min_0 => cfg_green_min_0,
        cfg_green_min_1 => cfg_green_min_1, cfg_excess_min_0 => cfg_excess_min_0,
        cfg_excess_min_1 => cfg_excess_min_1, cfg_saturation_min => cfg_saturation_min, cfg_clip_min => cfg_clip_min,
        cfg_clipped_weight => cfg_clipped_weight, cfg_centre_x => cfg_centre_x, cfg_centre_y => cfg_centre_y,
        cfg_mirror_radius => cfg_mirror_radius, cfg_inner_radius => cfg_inner_radius,
        cfg_cluster_gap => cfg_cluster_gap, cfg_min_pixels => cfg_min_pixels, cfg_clockwise => cfg_clockwise,
        cfg_lasers => cfg_lasers, cfg_first_edge => cfg_first_edge, cfg_sector_half_width => cfg_sector_half_width,
        cfg_noise_floor => cfg_noise_floor, cfg_noise => cfg_noise, cfg_azimuth_write => cfg_azimuth_write,
        cfg_azimuth_laser => cfg_azimuth_laser, cfg_azimuth => cfg_azimuth,
        s_axis_tvalid => gated_valid(camera), s_axis_tready => gated_ready(camera),
        s_axis_tdata => gated_data(DATA_BITS * (camera + 1) - 1 downto DATA_BITS * camera),
        s_axis_tuser => gated_user(camera), s_axis_tlast => gated_last(camera), s_axis_void => gated_void(camera),
        early_valid => early_valid(camera), early_slot => early_slot(camera), early_data => early_data(camera),
        mask_valid => mask_valid(camera), mask_laser => mask_laser(camera)(LASER_BITS - 1 downto 0),
        mask_slots => mask_slots(camera), mask_last => mask_last(camera),
        m_axis_tvalid => record_valid(camera), m_axis_tready => record_ready(camera),
        m_axis_tdata => record_data(camera), m_axis_tlast => record_last(camera),
        event_short_row => event_short_row(camera), event_long_row => event_long_row(camera),
        event_truncated => event_truncated(camera), event_stray_row => open, event_stalled => stalls(camera));

    masked(camera) <= mask_valid(camera) and mask_last(camera);

    laser_g : if LASER_BITS < 10 generate
      mask_laser(camera)(9 downto LASER_BITS) <= (others => '0');
    end generate;

  end generate;

  -- A beat that waits is told once
  event_stalled <= stalls and not stalled;

  stalled_p : process (clk)
  begin
    if rising_edge(clk) then
      stalled <= stalls;
    end if;
  end process;

  -- Spots of both cameras, one at a time

  later_p : process (clk)
  begin
    if rising_edge(clk) then
      if early_valid(1) = '1' then
        later_valid <= '1';
        later_bank  <= mask_bank(1);
        later_slot  <= early_slot(1);
        later_data  <= early_data(1);
      elsif early_valid(0) = '0' then
        later_valid <= '0';
      end if;
      if frame_rst = '1' then
        later_valid <= '0';
      end if;
    end if;
  end process;

  spot_valid  <= early_valid(0) or later_valid;
  spot_camera <= not early_valid(0);
  spot_bank   <= mask_bank(0) when early_valid(0) = '1' else later_bank;
  spot_slot   <= early_slot(0) when early_valid(0) = '1' else later_slot;
  spot_data   <= early_data(0) when early_valid(0) = '1' else later_data;
  spot_laser  <= spot_data(249 downto 240);

  -- Points

  reconstructor_settings_i : entity work.reconstructor_settings
    port map (
      clk => clk, load_valid => load_valid, load_address => load_address, load_data => load_data, lasers => lasers,
      paper => paper, single_camera => single_camera, range_min => range_min, range_max => range_max,
      chi2_max => chi2_max, write_valid => write_valid, write_table => write_table, write_entry => write_entry,
      write_word => write_word, write_data => write_data);

  reconstructor_i : entity work.reconstructor
    generic map (G_LASERS => G_LASERS, G_SLOT_BITS => G_SLOT_BITS, G_TERMS => 8, G_BITS_PER_STAGE => G_BITS_PER_STAGE)
    port map (
      clk => clk, rst => frame_rst, paper => paper, single_camera => single_camera, range_min => range_min,
      range_max => range_max, chi2_max => chi2_max, write_valid => write_valid, write_table => write_table,
      write_entry => write_entry, write_word => write_word, write_data => write_data,
      spot_valid => spot_valid, spot_bank => spot_bank, spot_camera => spot_camera, spot_laser => spot_laser,
      spot_slot => spot_slot, spot_data => spot_data,
      mask_valid => mask_valid, mask_bank => mask_bank, mask_laser_1 => mask_laser(0), mask_laser_2 => mask_laser(1),
      mask_slots_1 => mask_slots(0), mask_slots_2 => mask_slots(1),
      start => make_points, start_bank => make_bank, lasers => lasers, ready => make_ready, busy => make_busy,
      m_axis_tvalid => point_valid, m_axis_tdata => point_data, m_axis_tlast => point_last);

  -- Results

  first_bank <= start_bank(0) when start(0) = '1' else start_bank(1);

  results_i : entity work.frame_results
    generic map (G_Y_BITS => G_Y_BITS)
    port map (
      clk => clk, rst => rst, frame_reset => frame_reset, paper => paper, lasers => lasers, commits => commits,
      height_1 => heights(0), height_2 => heights(1), cycles => cycles, pair_start => start_first,
      pair_bank => first_bank, finish => finish, finish_bank => finish_bank, pair_done => pair_done,
      masked => masked, mask_bank => mask_bank, mask_paired => mask_paired, record_bank => record_bank,
      record_paired => record_paired, recorded => recorded,
      s_axis_tvalid => record_valid, s_axis_tready => record_ready, s_axis_tdata_1 => record_data(0),
      s_axis_tdata_2 => record_data(1), s_axis_tlast => record_last,
      start => make_points, start_bank => make_bank, start_ready => make_ready,
      point_valid => point_valid, point_data => point_data, point_last => point_last,
      result_write => result_write, result_record => result_record, result_data => result_data,
      spot_write => spot_write, spot_1_record => spot_1_record, spot_2_record => spot_2_record,
      results_done => results_done, event_overflow => event_overflow);

  registers_i : entity work.registers
    generic map (G_LASERS => G_LASERS, G_SLOTS => SLOTS, G_PPC => G_PPC)
    port map (
      clk => clk, rst => rst,
      s_axi_awvalid => s_axi_awvalid, s_axi_awready => s_axi_awready, s_axi_awaddr => s_axi_awaddr,
      s_axi_wvalid => s_axi_wvalid, s_axi_wready => s_axi_wready, s_axi_wdata => s_axi_wdata, s_axi_wstrb => s_axi_wstrb,
      s_axi_bvalid => s_axi_bvalid, s_axi_bready => s_axi_bready, s_axi_bresp => s_axi_bresp,
      s_axi_arvalid => s_axi_arvalid, s_axi_arready => s_axi_arready, s_axi_araddr => s_axi_araddr,
      s_axi_rvalid => s_axi_rvalid, s_axi_rready => s_axi_rready, s_axi_rdata => s_axi_rdata, s_axi_rresp => s_axi_rresp,
      interrupt => interrupt, configured => configured, enable => enable, committing => committing,
      frame_reset => frame_reset, frame_idle => frame_idle, in_frame => in_frame,
      event_short_row => event_short_row, event_long_row => event_long_row, event_truncated => event_truncated,
      event_stray_row => event_stray_row, event_overflow => event_overflow, event_stalled => event_stalled,
      event_unpaired => event_unpaired, event_skipped => event_skipped,
      cycles => cycles, commits => commits, load_valid => load_valid, load_address => load_address, load_data => load_data,
      result_write => result_write, result_record => result_record, result_data => result_data,
      spot_1_write => spot_write(0), spot_1_record => spot_1_record, spot_1_data => record_data(0),
      spot_2_write => spot_write(1), spot_2_record => spot_2_record, spot_2_data => record_data(1),
      results_done => results_done);

end architecture;
