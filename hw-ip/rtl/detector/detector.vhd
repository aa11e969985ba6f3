-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The streaming spot detector of one camera.
--
-- Purpose     pixels in, laser spots with sub-pixel positions out; no frame buffer
-- Chain       frame_control -> segment -> buffer -> serialize -> sector -> buffer -> run -> cluster -> centroid
--             -> spot_report
-- Latency     from the last pixel to the last spot: 82 clocks measured with 12 lasers; hw-ip/doc/detector.md
-- Throughput  G_PPC pixels per clock while hits are sparse; at least one hit per clock in runs. s_axis_tready falls when
--             the first buffer fills: no pixel is lost
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_core::SpotDetector
--
-- Result stream: a record per spot, lasers in rising order, then one with tlast per frame.
--             bits       spot                                frame
--             31..0      column, Q18.14                      -
--             63..32     row, Q18.14                         -
--             95..64     variance, px^2, Q8.24               -
--             127..96    pixels                              hits
--             159..128   saturated pixels                    hits outside the ring or the sectors
--             175..160   x_min                               hits lost for want of slots (32 bits)
--             191..176   x_max
--             207..192   y_min                               -
--             223..208   y_max                               -
--             239..224   r_max, 1/16 px                      rows taken
--             255..240   laser                               damaged rows

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity detector is
  generic (
    G_PPC        : positive range 1 to 8 := 1;    -- pixels per clock: 1, 2, 4 or 8
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this, not above the widest
    G_LASER_BITS : positive range 1 to 10 := 4;   -- most lasers: 2 ** this
    G_SLOT_BITS  : positive range 1 to 3 := 2     -- candidates per laser: 2 ** this
  );
  port (
    clk                   : in  std_ulogic;                                    -- rising edge
    rst                   : in  std_ulogic;                                    -- synchronous, high: forgets everything

    -- Configuration: constant while a frame is under way
    cfg_width             : in  std_ulogic_vector(G_X_BITS downto 0);          -- px, a multiple of G_PPC
    cfg_height            : in  std_ulogic_vector(G_Y_BITS downto 0);          -- px
    cfg_green_min_0       : in  std_ulogic_vector(7 downto 0);                 -- Thresholds::green_min
    cfg_green_min_1       : in  std_ulogic_vector(7 downto 0);
    cfg_excess_min_0      : in  std_ulogic_vector(8 downto 0);                 -- Thresholds::excess_min, 0 to 510
    cfg_excess_min_1      : in  std_ulogic_vector(8 downto 0);
    cfg_saturation_min    : in  std_ulogic_vector(7 downto 0);                 -- Thresholds::saturation_min
    cfg_clip_min          : in  std_ulogic_vector(7 downto 0);                 -- Thresholds::clip_min
    cfg_clipped_weight    : in  std_ulogic_vector(8 downto 0);                 -- Thresholds::clipped_weight, 1 to 500
    cfg_centre_x          : in  std_ulogic_vector(G_X_BITS + 4 downto 0);      -- image centre, 1/16 px, within the image
    cfg_centre_y          : in  std_ulogic_vector(G_Y_BITS + 4 downto 0);
    cfg_mirror_radius     : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::mirror_radius, 1/16 px
    cfg_inner_radius      : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::inner_radius, 1/16 px
    cfg_cluster_gap       : in  std_ulogic_vector(10 downto 0);                -- DetectorConfig::cluster_gap, px
    cfg_min_pixels        : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::min_pixels
    cfg_clockwise         : in  std_ulogic;                                    -- DetectorConfig::clockwise
    cfg_lasers            : in  std_ulogic_vector(G_LASER_BITS downto 0);      -- how many there are, at least 1
    cfg_first_edge        : in  std_ulogic_vector(15 downto 0);                -- azimuths[0] - 2 ** 15 / lasers, modulo 2 ** 16
    cfg_sector_half_width : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::sector_half_width
    cfg_noise_floor       : in  std_ulogic_vector(31 downto 0);                -- SpotNoise::floor
    cfg_noise             : in  std_ulogic_vector(31 downto 0);                -- SpotNoise::noise
    cfg_azimuth_write     : in  std_ulogic;                                    -- stores an azimuth
    cfg_azimuth_laser     : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);  -- of this laser
    cfg_azimuth           : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::azimuths, 2 ** -16 turn

    -- Pixels: AXI4-Stream Video
    s_axis_tvalid         : in  std_ulogic;                                    -- beat is there
    s_axis_tready         : out std_ulogic;                                    -- beat is taken if it is there
    s_axis_tdata          : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);    -- pixels, the leftmost in the low bits: R, B, G
                                                                               -- from the high byte down
    s_axis_tuser          : in  std_ulogic;                                    -- first beat of a frame
    s_axis_tlast          : in  std_ulogic;                                    -- last beat of a row
    s_axis_void           : in  std_ulogic := '0';                             -- with tuser: ends the frame under way, starts none

    -- Spots
    m_axis_tvalid         : out std_ulogic;                                    -- record is there, until it is taken
    m_axis_tready         : in  std_ulogic;                                    -- record is taken if it is there
    m_axis_tdata          : out std_ulogic_vector(255 downto 0);               -- the record
    m_axis_tlast          : out std_ulogic;                                    -- the frame's record

    -- The same records as soon as no later pixel can change them, before the frame ends: one clock each, at least 8 clocks
    -- between two, in any order. A slot may be given again in a frame: the last one counts
    early_valid           : out std_ulogic;                                    -- record is there
    early_slot            : out std_ulogic_vector(G_SLOT_BITS - 1 downto 0);   -- of this slot of its laser
    early_data            : out std_ulogic_vector(255 downto 0);               -- the record

    -- At the end of a frame: which slots hold a spot. One clock per laser, in rising order, after the last early record
    mask_valid            : out std_ulogic;                                    -- slots of a laser are there
    mask_laser            : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);  -- the laser
    mask_slots            : out std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);  -- its slots that hold a spot
    mask_last             : out std_ulogic;                                    -- the last laser

    -- Events: one clock each
    event_short_row       : out std_ulogic;                                    -- a row ended before the width
    event_long_row        : out std_ulogic;                                    -- a row ended after the width
    event_truncated       : out std_ulogic;                                    -- a frame ended before its height
    event_stray_row       : out std_ulogic;                                    -- a row outside a frame: after the last row, or
                                                                               -- without a start of frame
    event_stalled         : out std_ulogic                                     -- a beat had to wait for the buffers
  );
end entity;

architecture rtl of detector is

  constant LANE_BITS : positive := 13;

  -- Stages from frame_control's input to the first buffer, and from serialize's to the second
  constant BEAT_MARGIN : positive := 16;
  constant HIT_MARGIN  : positive := 40;

  -- Places in a buffered beat and in a buffered hit
  constant BEATS_Y_LOW    : positive := LANE_BITS * G_PPC;
  constant BEATS_X_LOW    : positive := BEATS_Y_LOW + G_Y_BITS + 1;
  constant BEATS_BITS : positive := BEATS_X_LOW + G_X_BITS + 1 + 1;

  constant HITS_WEIGHT_LOW : positive := G_X_BITS + 10;
  constant HITS_RADIUS_LOW : positive := HITS_WEIGHT_LOW + 12;
  constant HITS_Y_LOW      : positive := HITS_RADIUS_LOW + 2 * G_X_BITS + 10;
  constant HITS_X_LOW      : positive := HITS_Y_LOW + G_Y_BITS + 1;
  constant HITS_LASER_LOW  : positive := HITS_X_LOW + G_X_BITS + 1;
  constant HITS_BITS   : positive := HITS_LASER_LOW + G_LASER_BITS + 3;

  subtype x_t is std_ulogic_vector(G_X_BITS downto 0);
  subtype y_t is std_ulogic_vector(G_Y_BITS downto 0);
  subtype column_t is std_ulogic_vector(G_X_BITS - 1 downto 0);
  subtype row_t is std_ulogic_vector(G_Y_BITS - 1 downto 0);
  subtype laser_t is std_ulogic_vector(G_LASER_BITS - 1 downto 0);
  subtype radius_squared_t is std_ulogic_vector(2 * G_X_BITS + 9 downto 0);
  subtype mask_t is std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);
  subtype weight_t is std_ulogic_vector(9 downto 0);
  subtype count_t is std_ulogic_vector(G_X_BITS + G_Y_BITS downto 0);
  subtype beat_hits_t is std_ulogic_vector(LANE_BITS * G_PPC - 1 downto 0);

  signal beat_room  : std_ulogic;
  signal beat_valid : std_ulogic;
  signal beat_end   : std_ulogic;
  signal beat_start : std_ulogic;
  signal beat_x     : x_t;
  signal beat_y     : y_t;
  signal beat_data  : std_ulogic_vector(s_axis_tdata'range);

  signal segment_valid : std_ulogic;
  signal segment_end   : std_ulogic;
  signal segment_x     : x_t;
  signal segment_y     : y_t;
  signal segment_hits  : beat_hits_t;

  signal beats_in    : std_ulogic_vector(BEATS_BITS - 1 downto 0);
  signal beats_valid : std_ulogic;
  signal beats_ready : std_ulogic;
  signal beats_out   : std_ulogic_vector(BEATS_BITS - 1 downto 0);
  signal beats_end   : std_ulogic;
  signal beats_x     : x_t;
  signal beats_y     : y_t;
  signal beats_hits  : beat_hits_t;

  signal hit_room    : std_ulogic;
  signal hit_valid   : std_ulogic;
  signal hit_end     : std_ulogic;
  signal hit_x       : x_t;
  signal hit_y       : y_t;
  signal hit_green   : std_ulogic;
  signal hit_clipped : std_ulogic;
  signal hit_weight  : weight_t;

  signal sector_valid    : std_ulogic;
  signal sector_end      : std_ulogic;
  signal sector_accepted : std_ulogic;
  signal sector_joins    : std_ulogic;
  signal sector_laser    : laser_t;
  signal sector_x        : x_t;
  signal sector_y        : y_t;
  signal sector_radius_squared : radius_squared_t;
  signal sector_green    : std_ulogic;
  signal sector_clipped  : std_ulogic;
  signal sector_weight   : weight_t;
  signal sector_weight_x : std_ulogic_vector(G_X_BITS + 9 downto 0);

  signal hits_in       : std_ulogic_vector(HITS_BITS - 1 downto 0);
  signal hits_valid    : std_ulogic;
  signal hits_ready    : std_ulogic;
  signal hits_out      : std_ulogic_vector(HITS_BITS - 1 downto 0);
  signal hits_end      : std_ulogic;
  signal hits_accepted : std_ulogic;
  signal hits_joins    : std_ulogic;
  signal hits_laser    : laser_t;
  signal hits_x        : x_t;
  signal hits_y        : y_t;
  signal hits_radius_squared : radius_squared_t;
  signal hits_green    : std_ulogic;
  signal hits_clipped  : std_ulogic;
  signal hits_weight   : weight_t;
  signal hits_weight_x : std_ulogic_vector(G_X_BITS + 9 downto 0);

  signal run_valid     : std_ulogic;
  signal run_ready     : std_ulogic;
  signal run_end       : std_ulogic;
  signal run_laser     : laser_t;
  signal run_x_min     : x_t;
  signal run_x_max     : column_t;
  signal run_y         : y_t;
  signal run_pixels    : x_t;
  signal run_green     : x_t;
  signal run_saturated : x_t;
  signal run_weight    : std_ulogic_vector(G_X_BITS + 9 downto 0);
  signal run_weight_x  : std_ulogic_vector(2 * G_X_BITS + 9 downto 0);
  signal run_radius_squared : radius_squared_t;
  signal run_hits      : count_t;
  signal run_outside   : count_t;

  -- The row that frame_control is in, and the news for run that hits above a row have all come
  constant QUIET_BITS : positive := 6;
  signal quiet        : unsigned(QUIET_BITS - 1 downto 0);  -- clocks in which both buffers and run's second hit were empty
  signal current_row  : y_t;
  signal quiet_row    : y_t;                                -- the row when the first one began
  signal row_valid    : std_ulogic;
  signal row_ready    : std_ulogic;
  signal row          : y_t;

  signal word_valid : std_ulogic;
  signal word_frame : std_ulogic;
  signal word_last  : std_ulogic;
  signal word_index : std_ulogic_vector(3 downto 0);
  signal word_data  : std_ulogic_vector(2 * G_X_BITS + G_Y_BITS + 9 downto 0);
  signal word_laser : laser_t;
  signal word_slot  : std_ulogic_vector(G_SLOT_BITS - 1 downto 0);
  signal words_ready : std_ulogic;

  signal centroid_ready : std_ulogic;
  signal report_ready   : std_ulogic;
  signal frame_valid    : std_ulogic;
  signal record_laser   : laser_t;

begin

  frame_control_i : entity work.frame_control
    generic map (G_PPC => G_PPC, G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS)
    port map (
      clk             => clk,
      rst             => rst,
      cfg_width       => cfg_width,
      cfg_height      => cfg_height,
      s_axis_tvalid   => s_axis_tvalid,
      s_axis_tready   => s_axis_tready,
      s_axis_tdata    => s_axis_tdata,
      s_axis_tuser    => s_axis_tuser,
      s_axis_tlast    => s_axis_tlast,
      s_axis_void     => s_axis_void,
      room            => beat_room,
      out_valid       => beat_valid,
      out_end         => beat_end,
      out_start       => beat_start,
      out_x           => beat_x,
      out_y           => beat_y,
      out_data        => beat_data,
      event_short_row => event_short_row,
      event_long_row  => event_long_row,
      event_truncated => event_truncated,
      event_stray_row => event_stray_row
    );

  event_stalled <= s_axis_tvalid and not s_axis_tready and not beat_room;

  segment_i : entity work.segment
    generic map (G_PPC => G_PPC, G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS)
    port map (
      clk                => clk,
      rst                => rst,
      cfg_width          => cfg_width,
      cfg_green_min_0    => cfg_green_min_0,
      cfg_green_min_1    => cfg_green_min_1,
      cfg_excess_min_0   => cfg_excess_min_0,
      cfg_excess_min_1   => cfg_excess_min_1,
      cfg_saturation_min => cfg_saturation_min,
      cfg_clip_min       => cfg_clip_min,
      cfg_clipped_weight => cfg_clipped_weight,
      in_valid           => beat_valid,
      in_end             => beat_end,
      in_start           => beat_start,
      in_x               => beat_x,
      in_y               => beat_y,
      in_data            => beat_data,
      out_valid          => segment_valid,
      out_end            => segment_end,
      out_x              => segment_x,
      out_y              => segment_y,
      out_hits           => segment_hits
    );

  beats_in <= segment_end & segment_x & segment_y & segment_hits;

  beats_i : entity work.fifo
    generic map (G_WIDTH => BEATS_BITS, G_LOG2_DEPTH => 9, G_MARGIN => BEAT_MARGIN)
    port map (
      clk       => clk,
      rst       => rst,
      in_valid  => segment_valid,
      in_ready  => open,
      in_data   => beats_in,
      room      => beat_room,
      out_valid => beats_valid,
      out_ready => beats_ready,
      out_data  => beats_out
    );

  beats_end  <= beats_out(BEATS_BITS - 1);
  beats_x    <= beats_out(BEATS_X_LOW + G_X_BITS downto BEATS_X_LOW);
  beats_y    <= beats_out(BEATS_Y_LOW + G_Y_BITS downto BEATS_Y_LOW);
  beats_hits <= beats_out(BEATS_Y_LOW - 1 downto 0);

  serialize_i : entity work.serialize
    generic map (G_PPC => G_PPC, G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS)
    port map (
      clk         => clk,
      rst         => rst,
      in_valid    => beats_valid,
      in_ready    => beats_ready,
      in_end      => beats_end,
      in_x        => beats_x,
      in_y        => beats_y,
      in_hits     => beats_hits,
      room        => hit_room,
      out_valid   => hit_valid,
      out_end     => hit_end,
      out_x       => hit_x,
      out_y       => hit_y,
      out_green   => hit_green,
      out_clipped => hit_clipped,
      out_weight  => hit_weight
    );

  sector_i : entity work.sector
    generic map (G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASER_BITS => G_LASER_BITS)
    port map (
      clk                   => clk,
      rst                   => rst,
      cfg_centre_x          => cfg_centre_x,
      cfg_centre_y          => cfg_centre_y,
      cfg_mirror_radius     => cfg_mirror_radius,
      cfg_inner_radius      => cfg_inner_radius,
      cfg_clockwise         => cfg_clockwise,
      cfg_lasers            => cfg_lasers,
      cfg_first_edge        => cfg_first_edge,
      cfg_sector_half_width => cfg_sector_half_width,
      cfg_azimuth_write     => cfg_azimuth_write,
      cfg_azimuth_laser     => cfg_azimuth_laser,
      cfg_azimuth           => cfg_azimuth,
      in_valid              => hit_valid,
      in_end                => hit_end,
      in_x                  => hit_x,
      in_y                  => hit_y,
      in_green              => hit_green,
      in_clipped            => hit_clipped,
      in_weight             => hit_weight,
      out_valid             => sector_valid,
      out_end               => sector_end,
      out_accepted          => sector_accepted,
      out_joins             => sector_joins,
      out_laser             => sector_laser,
      out_x                 => sector_x,
      out_y                 => sector_y,
      out_radius_squared    => sector_radius_squared,
      out_green             => sector_green,
      out_clipped           => sector_clipped,
      out_weight            => sector_weight,
      out_weight_x          => sector_weight_x
    );

  hits_in <= sector_end & sector_accepted & sector_joins & sector_laser & sector_x & sector_y & sector_radius_squared
             & sector_green & sector_clipped & sector_weight & sector_weight_x;

  hits_i : entity work.fifo
    generic map (G_WIDTH => HITS_BITS, G_LOG2_DEPTH => 9, G_MARGIN => HIT_MARGIN)
    port map (
      clk       => clk,
      rst       => rst,
      in_valid  => sector_valid,
      in_ready  => open,
      in_data   => hits_in,
      room      => hit_room,
      out_valid => hits_valid,
      out_ready => hits_ready,
      out_data  => hits_out
    );

  hits_end      <= hits_out(HITS_BITS - 1);
  hits_accepted <= hits_out(HITS_BITS - 2);
  hits_joins    <= hits_out(HITS_BITS - 3);
  hits_laser    <= hits_out(HITS_LASER_LOW + G_LASER_BITS - 1 downto HITS_LASER_LOW);
  hits_x        <= hits_out(HITS_X_LOW + G_X_BITS downto HITS_X_LOW);
  hits_y        <= hits_out(HITS_Y_LOW + G_Y_BITS downto HITS_Y_LOW);
  hits_radius_squared <= hits_out(HITS_RADIUS_LOW + 2 * G_X_BITS + 9 downto HITS_RADIUS_LOW);
  hits_green    <= hits_out(HITS_WEIGHT_LOW + 11);
  hits_clipped  <= hits_out(HITS_WEIGHT_LOW + 10);
  hits_weight   <= hits_out(HITS_WEIGHT_LOW + 9 downto HITS_WEIGHT_LOW);
  hits_weight_x <= hits_out(HITS_WEIGHT_LOW - 1 downto 0);

  -- A hit is on its way for fewer than 2 ** QUIET_BITS clocks
  quiet_p : process (clk)
  begin
    if rising_edge(clk) then
      if beat_valid = '1' then
        current_row <= beat_y;
      end if;
      if row_ready = '1' then
        row_valid <= '0';
      end if;
      quiet <= quiet + 1;
      if beats_valid = '1' or hits_valid = '1' or hits_ready = '0' then
        quiet     <= (others => '0');
        quiet_row <= current_row;
      elsif quiet = 2 ** QUIET_BITS - 1 then
        row_valid <= '1';
        row       <= quiet_row;
        quiet_row <= current_row;
      end if;
      if rst = '1' then
        row_valid <= '0';
        quiet     <= (others => '0');
      end if;
    end if;
  end process;

  assert BEAT_MARGIN + HIT_MARGIN + 4 < 2 ** QUIET_BITS
    report "hits are on their way for too long" severity failure;

  run_i : entity work.run
    generic map (G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASER_BITS => G_LASER_BITS)
    port map (
      clk                => clk,
      rst                => rst,
      in_valid           => hits_valid,
      in_ready           => hits_ready,
      in_end             => hits_end,
      in_accepted        => hits_accepted,
      in_joins           => hits_joins,
      in_laser           => hits_laser,
      in_x               => hits_x,
      in_y               => hits_y,
      in_radius_squared  => hits_radius_squared,
      in_green           => hits_green,
      in_clipped         => hits_clipped,
      in_weight          => hits_weight,
      in_weight_x        => hits_weight_x,
      row_valid          => row_valid,
      row_ready          => row_ready,
      row                => row,
      out_valid          => run_valid,
      out_ready          => run_ready,
      out_end            => run_end,
      out_laser          => run_laser,
      out_x_min          => run_x_min,
      out_x_max          => run_x_max,
      out_y              => run_y,
      out_pixels         => run_pixels,
      out_green          => run_green,
      out_saturated      => run_saturated,
      out_weight         => run_weight,
      out_weight_x       => run_weight_x,
      out_radius_squared => run_radius_squared,
      hits               => run_hits,
      outside            => run_outside
    );

  words_ready <= centroid_ready and report_ready;

  cluster_i : entity work.cluster
    generic map (G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASER_BITS => G_LASER_BITS, G_SLOT_BITS => G_SLOT_BITS)
    port map (
      clk               => clk,
      rst               => rst,
      cfg_lasers        => cfg_lasers,
      cfg_cluster_gap   => cfg_cluster_gap,
      cfg_min_pixels    => cfg_min_pixels,
      in_valid          => run_valid,
      in_ready          => run_ready,
      in_end            => run_end,
      in_laser          => run_laser,
      in_x_min          => run_x_min,
      in_x_max          => run_x_max,
      in_y              => run_y,
      in_pixels         => run_pixels,
      in_green          => run_green,
      in_saturated      => run_saturated,
      in_weight         => run_weight,
      in_weight_x       => run_weight_x,
      in_radius_squared => run_radius_squared,
      in_hits           => run_hits,
      in_outside        => run_outside,
      word_valid        => word_valid,
      word_frame        => word_frame,
      word_last         => word_last,
      word_index        => word_index,
      word_data         => word_data,
      word_laser        => word_laser,
      word_slot         => word_slot,
      words_ready       => words_ready,
      mask_valid        => mask_valid,
      mask_laser        => mask_laser,
      mask_slots        => mask_slots,
      mask_last         => mask_last
    );

  centroid_i : entity work.centroid
    generic map (G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASER_BITS => G_LASER_BITS, G_SLOT_BITS => G_SLOT_BITS)
    port map (
      clk             => clk,
      rst             => rst,
      cfg_noise_floor => cfg_noise_floor,
      cfg_noise       => cfg_noise,
      word_valid      => word_valid,
      word_frame      => word_frame,
      word_last       => word_last,
      word_index      => word_index,
      word_data       => word_data,
      word_laser      => word_laser,
      word_slot       => word_slot,
      ready           => centroid_ready,
      spot_valid      => early_valid,
      frame_valid     => frame_valid,
      record_laser    => record_laser,
      record_slot     => early_slot,
      record_data     => early_data
    );

  report_i : entity work.spot_report
    generic map (G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASER_BITS => G_LASER_BITS, G_SLOT_BITS => G_SLOT_BITS)
    port map (
      clk           => clk,
      rst           => rst,
      ready         => report_ready,
      spot_valid    => early_valid,
      frame_valid   => frame_valid,
      record_laser  => record_laser,
      record_slot   => early_slot,
      record_data   => early_data,
      mask_valid    => mask_valid,
      mask_laser    => mask_laser,
      mask_slots    => mask_slots,
      mask_last     => mask_last,
      m_axis_tvalid => m_axis_tvalid,
      m_axis_tready => m_axis_tready,
      m_axis_tdata  => m_axis_tdata,
      m_axis_tlast  => m_axis_tlast
    );

end architecture;
