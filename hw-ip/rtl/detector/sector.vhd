-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The laser a hit belongs to, by its angle and radius.
--
-- Purpose     angle and squared distance about the image centre; the sector of the angle; whether the hit lies in the
--             mirror's ring and close enough to the laser's angle; whether it continues the run of the hit before it
-- Latency     26: difference 1, angle 18, sector 4, angle from the laser 2, decision and run 1
-- Throughput  one hit per clock, no stall
-- Resources   hw-ip/synth/resources.txt
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
    out_radius_squared    : out std_ulogic_vector(2 * G_X_BITS + 9 downto 0);  -- from the centre, (1/16 px) ** 2
    out_green             : out std_ulogic;                                    -- as in_green
    out_clipped           : out std_ulogic;                                    -- as in_clipped
    out_weight            : out std_ulogic_vector(9 downto 0);                 -- as in_weight
    out_weight_x          : out std_ulogic_vector(G_X_BITS + 9 downto 0)       -- weight times column
  );
end entity;

architecture rtl of sector is

  constant LATENCY : positive := 26;

  constant SQUARE_BITS : positive := 2 * G_X_BITS + 10;
  constant PLACE_BITS  : positive := 2 * G_X_BITS + G_Y_BITS + 26;

  -- A coordinate from the centre, 1/16 px
  subtype offset_t is signed(G_X_BITS + 5 downto 0);
  subtype square_t is unsigned(SQUARE_BITS - 1 downto 0);
  subtype laser_t is unsigned(G_LASER_BITS - 1 downto 0);
  type angle_array_t is array (natural range <>) of unsigned(15 downto 0);
  type laser_array_t is array (natural range <>) of laser_t;

  -- Index of a signal: clocks after the input
  signal valid_at : std_ulogic_vector(0 to LATENCY - 1);

  signal last_next_x : unsigned(G_X_BITS downto 0);  -- the column right of the last hit
  signal last_y      : unsigned(G_Y_BITS downto 0);
  signal is_next     : std_ulogic;

  signal dx_1, dy_1   : offset_t;
  signal dx_2, dy_2   : offset_t;
  signal x_square_3   : square_t;
  signal y_square_3   : square_t;
  signal x_square_4   : square_t;
  signal y_square_4   : square_t;
  signal square_5     : square_t;
  signal inner_square : unsigned(31 downto 0);
  signal outer_square : unsigned(31 downto 0);
  signal inner_limit  : unsigned(31 downto 0);  -- the squares again, beside the comparison
  signal outer_limit  : unsigned(31 downto 0);
  signal is_outside_6 : std_ulogic;
  signal is_inside_6  : std_ulogic;
  signal in_ring_at   : std_ulogic_vector(7 to LATENCY - 1);

  signal angle_19     : std_ulogic_vector(15 downto 0);
  signal from_edge_20 : unsigned(15 downto 0);
  signal lasers       : unsigned(G_LASER_BITS downto 0);  -- beside the multiplier
  signal product_21   : unsigned(16 + G_LASER_BITS downto 0);
  signal angle_at     : angle_array_t(20 to 23);
  signal laser_at     : laser_array_t(22 to LATENCY - 1);

  type azimuth_array_t is array (0 to 2 ** G_LASER_BITS - 1) of std_ulogic_vector(15 downto 0);
  signal azimuths     : azimuth_array_t;
  signal azimuth_22   : std_ulogic_vector(15 downto 0);
  signal azimuth_23   : std_ulogic_vector(15 downto 0);
  signal off_laser_24 : unsigned(15 downto 0);
  signal is_near_25   : std_ulogic;

  -- What waits for the angle
  signal place_1    : std_ulogic_vector(G_X_BITS + G_Y_BITS + 15 downto 0);
  signal place_2    : std_ulogic_vector(G_X_BITS + G_Y_BITS + 15 downto 0);
  signal x_1        : unsigned(G_X_BITS - 1 downto 0);
  signal weight_1   : unsigned(9 downto 0);
  signal weight_x_2 : unsigned(G_X_BITS + 9 downto 0);
  signal place_25   : std_ulogic_vector(PLACE_BITS - 1 downto 0);
  signal square_25  : std_ulogic_vector(SQUARE_BITS - 1 downto 0);
  signal is_end_25  : std_ulogic;
  signal is_next_25 : std_ulogic;
  signal accepted_25 : std_ulogic;

  -- The last hit of the frame
  signal last_accepted : std_ulogic;
  signal last_laser    : laser_t;

begin

  valid_p : process (clk)
  begin
    if rising_edge(clk) then
      valid_at(1 to LATENCY - 1) <= valid_at(0 to LATENCY - 2);
      if rst = '1' then
        valid_at(1 to LATENCY - 1) <= (others => '0');
      end if;
    end if;
  end process;

  valid_at(0) <= in_valid;

  -- 1, 2: coordinates from the centre, whether the hit is right of the last one, and weight times column
  is_next <= '1' when last_next_x = unsigned(in_x) and last_y = unsigned(in_y) else '0';

  difference_p : process (clk)
  begin
    if rising_edge(clk) then
      dx_1 <= signed(shift_left(resize(unsigned(in_x), offset_t'length), 4)) - signed(resize(unsigned(cfg_centre_x), offset_t'length));
      dy_1 <= signed(shift_left(resize(unsigned(in_y), offset_t'length), 4)) - signed(resize(unsigned(cfg_centre_y), offset_t'length));
      place_1    <= is_next & in_end & in_x & in_y & in_green & in_clipped & in_weight;
      place_2    <= place_1;
      x_1        <= unsigned(in_x(G_X_BITS - 1 downto 0));
      weight_1   <= unsigned(in_weight);
      weight_x_2 <= weight_1 * x_1;
      if in_valid = '1' then
        last_next_x <= unsigned(in_x) + 1;
        last_y      <= unsigned(in_y);
        lasers      <= unsigned(cfg_lasers);
      end if;
    end if;
  end process;

  place_i : entity work.delay_memory
    generic map (G_WIDTH => PLACE_BITS, G_CLOCKS => 23)
    port map (clk => clk, rst => rst, value => place_2 & std_ulogic_vector(weight_x_2), later => place_25);

  is_next_25 <= place_25(PLACE_BITS - 1);
  is_end_25  <= place_25(PLACE_BITS - 2);

  -- 2 to 7: squares
  squares_p : process (clk)
  begin
    if rising_edge(clk) then
      inner_square <= unsigned(cfg_inner_radius) * unsigned(cfg_inner_radius);
      outer_square <= unsigned(cfg_mirror_radius) * unsigned(cfg_mirror_radius);
      dx_2         <= dx_1;
      dy_2         <= dy_1;
      inner_limit  <= inner_square;
      outer_limit  <= outer_square;
      x_square_3   <= resize(unsigned(dx_2 * dx_2), SQUARE_BITS);
      y_square_3   <= resize(unsigned(dy_2 * dy_2), SQUARE_BITS);
      x_square_4   <= x_square_3;
      y_square_4   <= y_square_3;
      square_5     <= x_square_4 + y_square_4;
      is_inside_6  <= '1' when square_5 < inner_limit else '0';
      is_outside_6 <= '0' when square_5 < outer_limit else '1';
      in_ring_at   <= (is_inside_6 nor is_outside_6) & in_ring_at(7 to LATENCY - 2);
    end if;
  end process;

  square_i : entity work.delay_memory
    generic map (G_WIDTH => SQUARE_BITS, G_CLOCKS => 20)
    port map (clk => clk, rst => rst, value => std_ulogic_vector(square_5), later => square_25);

  azimuth_i : entity work.azimuth
    generic map (G_BITS => G_X_BITS + 5)
    port map (
      clk      => clk,
      reversed => cfg_clockwise,
      x        => std_ulogic_vector(dx_1),
      y        => std_ulogic_vector(dy_1),
      angle    => angle_19
    );

  azimuths_p : process (clk)
  begin
    if rising_edge(clk) then
      azimuth_22 <= azimuths(to_integer(product_21(15 + G_LASER_BITS downto 16)));
      if cfg_azimuth_write = '1' then
        azimuths(to_integer(unsigned(cfg_azimuth_laser))) <= cfg_azimuth;
      end if;
    end if;
  end process;

  sector_p : process (clk)
    variable magnitude : unsigned(15 downto 0);
    variable spare     : unsigned(17 downto 0);
  begin
    if rising_edge(clk) then
      angle_at <= unsigned(angle_19) & angle_at(20 to 22);
      laser_at <= product_21(15 + G_LASER_BITS downto 16) & laser_at(22 to LATENCY - 2);

      -- 20 to 23: index of the sector, and its laser
      from_edge_20 <= unsigned(angle_19) - unsigned(cfg_first_edge);
      product_21   <= from_edge_20 * lasers;
      azimuth_23   <= azimuth_22;

      -- 24, 25: close enough to the laser: the half width less the complement of a negative angle, and one, is not negative
      off_laser_24 <= angle_at(23) - unsigned(azimuth_23);
      magnitude    := off_laser_24 xor (15 downto 0 => off_laser_24(15));
      spare        := ('0' & unsigned(cfg_sector_half_width) & '0') - ('0' & magnitude & off_laser_24(15));
      is_near_25   <= not spare(17);
    end if;
  end process;

  accepted_25 <= is_near_25 and in_ring_at(25) and not is_end_25;

  -- 26: the result
  result_p : process (clk)
  begin
    if rising_edge(clk) then
      out_joins <= '0';
      if is_next_25 = '1' and last_accepted = '1' and last_laser = laser_at(25) then
        out_joins <= '1';
      end if;
      if valid_at(25) = '1' then
        last_accepted <= accepted_25;
        last_laser    <= laser_at(25);
      end if;
      out_valid    <= valid_at(25);
      out_end      <= is_end_25;
      out_accepted <= accepted_25;
      out_laser    <= std_ulogic_vector(laser_at(25));
      out_x        <= place_25(PLACE_BITS - 3 downto PLACE_BITS - 3 - G_X_BITS);
      out_y        <= place_25(G_X_BITS + G_Y_BITS + 22 downto G_X_BITS + 22);
      out_green    <= place_25(G_X_BITS + 21);
      out_clipped  <= place_25(G_X_BITS + 20);
      out_weight   <= place_25(G_X_BITS + 19 downto G_X_BITS + 10);
      out_weight_x <= place_25(G_X_BITS + 9 downto 0);
      out_radius_squared <= square_25;
      if rst = '1' then
        out_valid     <= '0';
        last_accepted <= '0';
      end if;
    end if;
  end process;

end architecture;
