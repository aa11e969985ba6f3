-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The laser a hit belongs to, by its angle and radius.
--
-- Purpose     polar coordinates about the image centre; the sector of the angle; whether the hit lies in the mirror's ring
--             and close enough to the laser's angle; whether it continues the run of the hit before it
-- Latency     32: difference 1, polar 22, sector 4, angle from the laser 3, decision 1, run 1
-- Throughput  one hit per clock, no stall
-- Resources   polar, about 200 LUT and 2 DSP, one memory of lasers by 16
-- Twin        karst_core: SpotDetector::row, DetectorConfig::{laser_angle, sector}

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity sector is
  generic (
    G_X_BITS      : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS      : positive range 1 to 11 := 10;  -- highest image: 2 ** this, not above the widest
    G_LASER_BITS  : positive range 1 to 10 := 4    -- most lasers: 2 ** this
  );
  port (
    clk                   : in  std_ulogic;                                    -- rising edge
    rst                   : in  std_ulogic;                                    -- synchronous, high: forgets what is under way
    cfg_centre_x          : in  std_ulogic_vector(G_X_BITS + 4 downto 0);      -- image centre, 1/16 px, within the image
    cfg_centre_y          : in  std_ulogic_vector(G_Y_BITS + 4 downto 0);
    cfg_mirror_radius     : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::mirror_radius, 1/16 px
    cfg_inner_radius      : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::inner_radius, 1/16 px
    cfg_clockwise         : in  std_ulogic;                                    -- DetectorConfig::clockwise
    cfg_lasers            : in  std_ulogic_vector(G_LASER_BITS downto 0);      -- how many there are
    cfg_first_edge        : in  std_ulogic_vector(15 downto 0);                -- the first azimuth minus half a sector,
                                                                               -- 2 ** 15 / lasers rounded down, 2 ** -16 turn
    cfg_sector_half_width : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::sector_half_width
    cfg_azimuth_write     : in  std_ulogic;                                    -- stores an azimuth
    cfg_azimuth_laser     : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);  -- of this laser
    cfg_azimuth           : in  std_ulogic_vector(15 downto 0);                -- DetectorConfig::azimuths, 2 ** -16 turn
    in_valid              : in  std_ulogic;                                    -- as the outputs of serialize
    in_end                : in  std_ulogic;
    in_x                  : in  std_ulogic_vector(G_X_BITS downto 0);
    in_y                  : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_green              : in  std_ulogic;
    in_clipped            : in  std_ulogic;
    in_weight             : in  std_ulogic_vector(9 downto 0);
    out_valid             : out std_ulogic;                                    -- hit, or the end of a frame
    out_end               : out std_ulogic;                                    -- end of a frame
    out_accepted          : out std_ulogic;                                    -- the hit is in the ring and near a laser
    out_joins             : out std_ulogic;                                    -- it continues the run of the last accepted one
    out_laser             : out std_ulogic_vector(G_LASER_BITS - 1 downto 0);  -- index of the laser
    out_x                 : out std_ulogic_vector(G_X_BITS downto 0);          -- as in_x
    out_y                 : out std_ulogic_vector(G_Y_BITS downto 0);          -- as in_y
    out_radius            : out std_ulogic_vector(G_X_BITS + 4 downto 0);      -- distance from the centre, 1/16 px
    out_green             : out std_ulogic;                                    -- as in_green
    out_clipped           : out std_ulogic;                                    -- as in_clipped
    out_weight            : out std_ulogic_vector(9 downto 0);                 -- as in_weight
    out_weight_x          : out std_ulogic_vector(G_X_BITS + 9 downto 0)       -- weight times column
  );
end entity;

architecture rtl of sector is

  constant POLAR_BITS : positive := G_X_BITS + 4;
  constant LATENCY    : positive := 32;

  -- Index of a signal that is delayed: clocks after the input
  subtype x_t is unsigned(G_X_BITS downto 0);
  subtype y_t is unsigned(G_Y_BITS downto 0);
  subtype laser_t is unsigned(G_LASER_BITS - 1 downto 0);
  type x_array_t is array (natural range <>) of x_t;
  type y_array_t is array (natural range <>) of y_t;
  type weight_array_t is array (natural range <>) of unsigned(9 downto 0);
  type radius_array_t is array (natural range <>) of unsigned(POLAR_BITS downto 0);
  type angle_array_t is array (natural range <>) of unsigned(15 downto 0);
  type laser_array_t is array (natural range <>) of laser_t;

  signal valid_at   : std_ulogic_vector(0 to LATENCY - 1);
  signal end_at     : std_ulogic_vector(0 to LATENCY - 1);
  signal green_at   : std_ulogic_vector(0 to LATENCY - 1);
  signal clipped_at : std_ulogic_vector(0 to LATENCY - 1);
  signal x_at       : x_array_t(0 to LATENCY - 1);
  signal y_at       : y_array_t(0 to LATENCY - 1);
  signal weight_at  : weight_array_t(0 to LATENCY - 1);
  signal angle_at   : angle_array_t(24 to 28);
  signal radius_at  : radius_array_t(24 to LATENCY - 1);
  signal laser_at   : laser_array_t(27 to LATENCY - 1);

  signal dx : signed(POLAR_BITS + 1 downto 0);
  signal dy : signed(POLAR_BITS + 1 downto 0);

  signal polar_radius : std_ulogic_vector(POLAR_BITS downto 0);
  signal polar_angle  : std_ulogic_vector(15 downto 0);

  signal from_edge    : unsigned(15 downto 0);
  signal product      : unsigned(16 + G_LASER_BITS downto 0);
  signal product_held : unsigned(16 + G_LASER_BITS downto 0);

  type azimuth_array_t is array (0 to 2 ** G_LASER_BITS - 1) of std_ulogic_vector(15 downto 0);
  signal azimuths      : azimuth_array_t;
  signal azimuth       : std_ulogic_vector(15 downto 0);
  signal off_laser     : unsigned(15 downto 0);
  signal off_magnitude : unsigned(15 downto 0);
  signal in_ring       : std_ulogic;
  signal accepted      : std_ulogic;

  signal weight_x      : unsigned(G_X_BITS + 9 downto 0);
  signal weight_x_held : unsigned(G_X_BITS + 9 downto 0);

  -- The last accepted hit of the frame
  signal last_valid  : std_ulogic;
  signal last_next_x : x_t;  -- the column right of it
  signal last_y      : y_t;
  signal last_laser  : laser_t;

begin

  valid_at(0)   <= in_valid;
  end_at(0)     <= in_end;
  green_at(0)   <= in_green;
  clipped_at(0) <= in_clipped;
  x_at(0)       <= unsigned(in_x);
  y_at(0)       <= unsigned(in_y);
  weight_at(0)  <= unsigned(in_weight);

  delay_p : process (clk)
  begin
    if rising_edge(clk) then
      end_at(1 to LATENCY - 1)     <= end_at(0 to LATENCY - 2);
      green_at(1 to LATENCY - 1)   <= green_at(0 to LATENCY - 2);
      clipped_at(1 to LATENCY - 1) <= clipped_at(0 to LATENCY - 2);
      x_at(1 to LATENCY - 1)       <= x_at(0 to LATENCY - 2);
      y_at(1 to LATENCY - 1)       <= y_at(0 to LATENCY - 2);
      weight_at(1 to LATENCY - 1)  <= weight_at(0 to LATENCY - 2);
      valid_at(1 to LATENCY - 1)   <= valid_at(0 to LATENCY - 2);
      if rst = '1' then
        valid_at(1 to LATENCY - 1) <= (others => '0');
      end if;
    end if;
  end process;

  difference_p : process (clk)
  begin
    if rising_edge(clk) then
      dx <= signed(shift_left(resize(unsigned(in_x), dx'length), 4)) - signed(resize(unsigned(cfg_centre_x), dx'length));
      dy <= signed(shift_left(resize(unsigned(in_y), dy'length), 4)) - signed(resize(unsigned(cfg_centre_y), dy'length));
    end if;
  end process;

  polar_i : entity work.polar
    generic map (G_BITS => POLAR_BITS)
    port map (
      clk       => clk,
      rst       => rst,
      in_valid  => valid_at(1),
      x         => std_ulogic_vector(dx),
      y         => std_ulogic_vector(dy),
      out_valid => open,
      radius    => polar_radius,
      angle     => polar_angle
    );

  azimuths_p : process (clk)
  begin
    if rising_edge(clk) then
      azimuth <= azimuths(to_integer(laser_at(27)));
      if cfg_azimuth_write = '1' then
        azimuths(to_integer(unsigned(cfg_azimuth_laser))) <= cfg_azimuth;
      end if;
    end if;
  end process;

  laser_at(27) <= product_held(15 + G_LASER_BITS downto 16);

  sector_p : process (clk)
  begin
    if rising_edge(clk) then
      angle_at(24) <= unsigned(polar_angle);
      if cfg_clockwise = '1' then
        angle_at(24) <= not unsigned(polar_angle) + 1;
      end if;
      radius_at(24) <= unsigned(polar_radius);
      angle_at(25 to 28)              <= angle_at(24 to 27);
      radius_at(25 to LATENCY - 1)    <= radius_at(24 to LATENCY - 2);
      laser_at(28 to LATENCY - 1)     <= laser_at(27 to LATENCY - 2);

      -- 25 to 27: index of the sector
      from_edge    <= angle_at(24) - unsigned(cfg_first_edge);
      product      <= from_edge * unsigned(cfg_lasers);
      product_held <= product;

      -- 29 to 31: close enough to the laser and to the mirror
      off_laser <= angle_at(28) - unsigned(azimuth);
      if off_laser(15) = '1' then
        off_magnitude <= not off_laser + 1;
      else
        off_magnitude <= off_laser;
      end if;
      in_ring <= '0';
      if radius_at(29) >= unsigned(cfg_inner_radius) and radius_at(29) <= unsigned(cfg_mirror_radius) then
        in_ring <= '1';
      end if;
      accepted <= in_ring;
      if off_magnitude > unsigned(cfg_sector_half_width) or end_at(30) = '1' then
        accepted <= '0';
      end if;
      weight_x      <= weight_at(29) * x_at(29)(G_X_BITS - 1 downto 0);
      weight_x_held <= weight_x;

      -- 32: right of the last accepted hit and of the same laser
      out_joins <= '0';
      if last_valid = '1' and last_next_x = x_at(31) and last_y = y_at(31) and last_laser = laser_at(31) then
        out_joins <= '1';
      end if;
      if valid_at(31) = '1' and accepted = '1' then
        last_valid  <= '1';
        last_next_x <= x_at(31) + 1;
        last_y      <= y_at(31);
        last_laser  <= laser_at(31);
      end if;
      if valid_at(31) = '1' and end_at(31) = '1' then
        last_valid <= '0';
      end if;
      out_valid    <= valid_at(31);
      out_end      <= end_at(31);
      out_accepted <= accepted;
      out_laser    <= std_ulogic_vector(laser_at(31));
      out_x        <= std_ulogic_vector(x_at(31));
      out_y        <= std_ulogic_vector(y_at(31));
      out_radius   <= std_ulogic_vector(radius_at(31));
      out_green    <= green_at(31);
      out_clipped  <= clipped_at(31);
      out_weight   <= std_ulogic_vector(weight_at(31));
      out_weight_x <= std_ulogic_vector(weight_x_held);
      if rst = '1' then
        out_valid  <= '0';
        last_valid <= '0';
      end if;
    end if;
  end process;

end architecture;
