-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The settings of one camera's detector.
--
-- Purpose     picks the detector's words out of the settings as they are streamed, and holds them
-- Latency     1
-- Throughput  a word per clock
-- Resources   about 290 FF and 30 LUT
-- Twin        karst_regs::Settings: the words of DetectorConfig

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.karst_map_pkg.all;

entity detector_settings is
  generic (
    G_CAMERA     : natural range 0 to 1 := 0;     -- index of the camera
    G_X_BITS     : positive range 7 to 11 := 10;  -- as detector
    G_Y_BITS     : positive range 1 to 11 := 10;  -- as detector
    G_LASER_BITS : positive range 1 to 10 := 4    -- as detector
  );
  port (
    clk                   : in  std_ulogic;                                    -- rising edge
    load_valid            : in  std_ulogic;                                    -- a word, while no frame is under way
    load_address          : in  std_ulogic_vector(15 downto 0);                -- its address in words
    load_data             : in  std_ulogic_vector(31 downto 0);                -- the word
    cfg_width             : out std_ulogic_vector(G_X_BITS downto 0);          -- image width, px
    cfg_height            : out std_ulogic_vector(G_Y_BITS downto 0);          -- image height, px
    cfg_green_min_0       : out std_ulogic_vector(7 downto 0);                 -- Thresholds::green_min
    cfg_green_min_1       : out std_ulogic_vector(7 downto 0);                 -- the second one
    cfg_excess_min_0      : out std_ulogic_vector(8 downto 0);                 -- Thresholds::excess_min
    cfg_excess_min_1      : out std_ulogic_vector(8 downto 0);                 -- the second one
    cfg_saturation_min    : out std_ulogic_vector(7 downto 0);                 -- Thresholds::saturation_min
    cfg_clip_min          : out std_ulogic_vector(7 downto 0);                 -- Thresholds::clip_min
    cfg_clipped_weight    : out std_ulogic_vector(8 downto 0);                 -- Thresholds::clipped_weight
    cfg_centre_x          : out std_ulogic_vector(G_X_BITS + 4 downto 0);      -- image centre, 1/16 px
    cfg_centre_y          : out std_ulogic_vector(G_Y_BITS + 4 downto 0);      -- image centre, 1/16 px
    cfg_mirror_radius     : out std_ulogic_vector(15 downto 0);                -- DetectorConfig::mirror_radius, 1/16 px
    cfg_inner_radius      : out std_ulogic_vector(15 downto 0);                -- DetectorConfig::inner_radius, 1/16 px
    cfg_cluster_gap       : out std_ulogic_vector(10 downto 0);                -- DetectorConfig::cluster_gap, px
    cfg_min_pixels        : out std_ulogic_vector(15 downto 0);                -- DetectorConfig::min_pixels
    cfg_clockwise         : out std_ulogic;                                    -- DetectorConfig::clockwise
    cfg_lasers            : out std_ulogic_vector(G_LASER_BITS downto 0);      -- how many there are
    cfg_first_edge        : out std_ulogic_vector(15 downto 0);                -- lower edge of the first sector, 2 ** -16 turn
    cfg_sector_half_width : out std_ulogic_vector(15 downto 0);                -- DetectorConfig::sector_half_width
    cfg_noise_floor       : out std_ulogic_vector(31 downto 0);                -- SpotNoise::floor
    cfg_noise             : out std_ulogic_vector(31 downto 0);                -- SpotNoise::noise
    cfg_azimuth_write     : out std_ulogic;                                    -- an azimuth for the detector's memory
    cfg_azimuth_laser     : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);  -- of this laser
    cfg_azimuth           : out std_ulogic_vector(15 downto 0)                 -- DetectorConfig::azimuths, 2 ** -16 turn
  );
end entity;

architecture rtl of detector_settings is

  -- Word of the settings memory at a byte address
  function word(address : natural) return natural is
  begin
    return (address - SETTINGS_INSTRUMENT_LASERS) / 4;
  end function;

  constant CAMERA     : natural := G_CAMERA * SETTINGS_CAMERA_STRIDE;
  constant SIZE       : natural := word(SETTINGS_CAMERA_DETECTOR_SIZE + CAMERA);
  constant GREEN_MIN  : natural := word(SETTINGS_CAMERA_DETECTOR_GREEN_MIN + CAMERA);
  constant EXCESS_MIN : natural := word(SETTINGS_CAMERA_DETECTOR_EXCESS_MIN + CAMERA);
  constant WEIGHT     : natural := word(SETTINGS_CAMERA_DETECTOR_WEIGHT + CAMERA);
  constant CENTRE     : natural := word(SETTINGS_CAMERA_DETECTOR_CENTRE + CAMERA);
  constant RADIUS     : natural := word(SETTINGS_CAMERA_DETECTOR_RADIUS + CAMERA);
  constant CLUSTER    : natural := word(SETTINGS_CAMERA_DETECTOR_CLUSTER + CAMERA);
  constant SECTOR     : natural := word(SETTINGS_CAMERA_DETECTOR_SECTOR + CAMERA);
  constant FLOOR      : natural := word(SETTINGS_CAMERA_DETECTOR_NOISE_FLOOR + CAMERA);
  constant NOISE      : natural := word(SETTINGS_CAMERA_DETECTOR_NOISE + CAMERA);
  constant LASERS     : natural := word(SETTINGS_INSTRUMENT_LASERS);
  constant AZIMUTH    : natural := word(SETTINGS_LASER_AZIMUTH);  -- of the first laser
  constant STRIDE     : natural := SETTINGS_LASER_STRIDE / 4;     -- a power of two, and AZIMUTH a multiple of it

begin

  settings_p : process (clk)
    -- The low bits of a field
    procedure hold(signal setting : out std_ulogic_vector; field : std_ulogic_vector) is
    begin
      setting <= std_ulogic_vector(resize(unsigned(field), setting'length));
    end procedure;
    variable at : natural range 0 to 65535;
  begin
    if rising_edge(clk) then
      cfg_azimuth_write <= '0';
      if load_valid = '1' then
        at := to_integer(unsigned(load_address));
        if at = LASERS then
          hold(cfg_lasers, load_data(SETTINGS_INSTRUMENT_LASERS_COUNT));
        elsif at = SIZE then
          hold(cfg_width, load_data(SETTINGS_CAMERA_DETECTOR_SIZE_WIDTH));
          hold(cfg_height, load_data(SETTINGS_CAMERA_DETECTOR_SIZE_HEIGHT));
        elsif at = GREEN_MIN then
          cfg_green_min_0    <= load_data(SETTINGS_CAMERA_DETECTOR_GREEN_MIN_FIRST);
          cfg_green_min_1    <= load_data(SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SECOND);
          cfg_saturation_min <= load_data(SETTINGS_CAMERA_DETECTOR_GREEN_MIN_SATURATION);
          cfg_clip_min       <= load_data(SETTINGS_CAMERA_DETECTOR_GREEN_MIN_CLIP);
        elsif at = EXCESS_MIN then
          cfg_excess_min_0 <= load_data(SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_FIRST);
          cfg_excess_min_1 <= load_data(SETTINGS_CAMERA_DETECTOR_EXCESS_MIN_SECOND);
        elsif at = WEIGHT then
          cfg_clipped_weight <= load_data(SETTINGS_CAMERA_DETECTOR_WEIGHT_CLIPPED_WEIGHT);
          cfg_clockwise      <= load_data(SETTINGS_CAMERA_DETECTOR_WEIGHT_CLOCKWISE);
        elsif at = CENTRE then
          hold(cfg_centre_x, load_data(SETTINGS_CAMERA_DETECTOR_CENTRE_X));
          hold(cfg_centre_y, load_data(SETTINGS_CAMERA_DETECTOR_CENTRE_Y));
        elsif at = RADIUS then
          cfg_inner_radius  <= load_data(SETTINGS_CAMERA_DETECTOR_RADIUS_INNER);
          cfg_mirror_radius <= load_data(SETTINGS_CAMERA_DETECTOR_RADIUS_MIRROR);
        elsif at = CLUSTER then
          cfg_cluster_gap <= load_data(SETTINGS_CAMERA_DETECTOR_CLUSTER_GAP);
          cfg_min_pixels  <= load_data(SETTINGS_CAMERA_DETECTOR_CLUSTER_MIN_PIXELS);
        elsif at = SECTOR then
          cfg_sector_half_width <= load_data(SETTINGS_CAMERA_DETECTOR_SECTOR_HALF_WIDTH);
          cfg_first_edge        <= load_data(SETTINGS_CAMERA_DETECTOR_SECTOR_FIRST_EDGE);
        elsif at = FLOOR then
          cfg_noise_floor <= load_data;
        elsif at = NOISE then
          cfg_noise <= load_data;
        elsif at >= AZIMUTH and at mod STRIDE = 0 then
          cfg_azimuth_write <= '1';
        end if;
        cfg_azimuth_laser <= std_ulogic_vector(resize(unsigned(load_address) / STRIDE - AZIMUTH / STRIDE, G_LASER_BITS));
        if G_CAMERA = 0 then
          cfg_azimuth <= load_data(SETTINGS_LASER_AZIMUTH_CAMERA_1);
        else
          cfg_azimuth <= load_data(SETTINGS_LASER_AZIMUTH_CAMERA_2);
        end if;
      end if;
    end if;
  end process;

end architecture;
