-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Class and weight of one pixel, given the background around it.
--
-- Purpose     eq. 2 of the paper over the local background, the saturated core, the weight in the centroid, and what the
--             pixel adds to the background of the next rows
-- Latency     6
-- Throughput  one per clock, no stall. No reset: it has no state
-- Resources   about 170 LUT, 3 DSP
-- Twin        karst_core: Background::towards, Thresholds::classify, Sums::replace

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity classify is
  port (
    clk                : in  std_ulogic;                      -- rising edge
    cfg_green_min_0    : in  std_ulogic_vector(7 downto 0);   -- Thresholds::green_min
    cfg_green_min_1    : in  std_ulogic_vector(7 downto 0);
    cfg_excess_min_0   : in  std_ulogic_vector(8 downto 0);   -- Thresholds::excess_min
    cfg_excess_min_1   : in  std_ulogic_vector(8 downto 0);
    cfg_saturation_min : in  std_ulogic_vector(7 downto 0);   -- Thresholds::saturation_min
    cfg_clip_min       : in  std_ulogic_vector(7 downto 0);   -- Thresholds::clip_min
    lowest_excess      : in  std_ulogic_vector(8 downto 0);   -- the smaller of the two thresholds on 2G-R-B
    full_weight        : in  std_ulogic_vector(8 downto 0);   -- Thresholds::clipped_weight, 1 to 500
    full_and_lowest    : in  std_ulogic_vector(9 downto 0);   -- sum of these two
    red                : in  std_ulogic_vector(7 downto 0);   -- the pixel
    green              : in  std_ulogic_vector(7 downto 0);
    blue               : in  std_ulogic_vector(7 downto 0);
    from_green         : in  std_ulogic_vector(7 downto 0);   -- background at the middle of the block to the left
    from_red_blue      : in  std_ulogic_vector(8 downto 0);
    to_green           : in  std_ulogic_vector(7 downto 0);   -- background at the middle of the block to the right
    to_red_blue        : in  std_ulogic_vector(8 downto 0);
    step               : in  std_ulogic_vector(5 downto 0);   -- from left to right, of 64
    hit                : out std_ulogic;                      -- the pixel belongs to a spot
    hit_green          : out std_ulogic;                      -- it is green, not only saturated
    hit_clipped        : out std_ulogic;                      -- it is clipped or a core
    hit_weight         : out std_ulogic_vector(9 downto 0);   -- 1 to 1010
    sum_green          : out std_ulogic_vector(7 downto 0);   -- for the next background; at the time of hit
    sum_red_blue       : out std_ulogic_vector(8 downto 0)
  );
end entity;

architecture rtl of classify is

  subtype byte_t is unsigned(7 downto 0);
  type byte_array_t is array (natural range <>) of byte_t;
  type red_blue_array_t is array (natural range <>) of unsigned(8 downto 0);

  -- Index: the stage that reads it
  signal g_at  : byte_array_t(2 to 6);
  signal rb_at : red_blue_array_t(2 to 6);

  signal core_at       : std_ulogic_vector(2 to 6);
  signal full_scale_at : std_ulogic_vector(2 to 6);
  signal above_0_at    : std_ulogic_vector(2 to 6);
  signal above_1_at    : std_ulogic_vector(2 to 6);

  -- 2: interpolation
  signal green_product    : signed(15 downto 0);
  signal red_blue_product : signed(16 downto 0);
  signal green_from       : unsigned(7 downto 0);
  signal red_blue_from    : unsigned(8 downto 0);
  -- 3: background
  signal background_green    : byte_t;
  signal background_red_blue : unsigned(8 downto 0);
  signal plain_excess        : signed(10 downto 0);
  -- 4
  signal background_excess : signed(10 downto 0);
  signal excess_4          : signed(10 downto 0);
  signal lost              : unsigned(17 downto 0);
  signal over_4            : unsigned(8 downto 0);
  signal share_green_4     : byte_t;
  signal share_red_blue_4  : unsigned(8 downto 0);
  -- 5
  signal excess_5          : signed(10 downto 0);
  signal left_5            : unsigned(8 downto 0);
  signal over_5            : unsigned(8 downto 0);
  signal share_green_5     : byte_t;
  signal share_red_blue_5  : unsigned(8 downto 0);
  -- 6
  signal is_green          : std_ulogic;
  signal clipped_weight    : unsigned(9 downto 0);
  signal green_weight      : unsigned(9 downto 0);
  signal share_green_6     : byte_t;
  signal share_red_blue_6  : unsigned(8 downto 0);

begin

  stages_p : process (clk)
    variable green_interpolated    : signed(15 downto 0);
    variable red_blue_interpolated : signed(16 downto 0);
    variable twice_minus           : signed(10 downto 0);
    variable full_left             : signed(10 downto 0);
    variable green_share           : unsigned(11 downto 0);
    variable red_blue_share        : unsigned(12 downto 0);
    variable difference            : unsigned(10 downto 0);
  begin
    if rising_edge(clk) then
      -- 1: what needs the pixel alone, and the products of the interpolation
      g_at(2)  <= unsigned(green);
      rb_at(2) <= resize(unsigned(red), 9) + unsigned(blue);
      core_at(2) <= '1' when unsigned(red) >= unsigned(cfg_saturation_min) and unsigned(green) >= unsigned(cfg_saturation_min)
                             and unsigned(blue) >= unsigned(cfg_saturation_min) else '0';
      full_scale_at(2) <= '1' when unsigned(green) >= unsigned(cfg_clip_min) else '0';
      above_0_at(2)    <= '1' when unsigned(green) > unsigned(cfg_green_min_0) else '0';
      above_1_at(2)    <= '1' when unsigned(green) > unsigned(cfg_green_min_1) else '0';
      green_product    <= (signed('0' & to_green) - signed('0' & from_green)) * signed('0' & step);
      red_blue_product <= (signed('0' & to_red_blue) - signed('0' & from_red_blue)) * signed('0' & step);
      green_from       <= unsigned(from_green);
      red_blue_from    <= unsigned(from_red_blue);

      g_at(3 to 6)          <= g_at(2 to 5);
      rb_at(3 to 6)         <= rb_at(2 to 5);
      core_at(3 to 6)       <= core_at(2 to 5);
      full_scale_at(3 to 6) <= full_scale_at(2 to 5);
      above_0_at(3 to 6)    <= above_0_at(2 to 5);
      above_1_at(3 to 6)    <= above_1_at(2 to 5);

      -- 2: background
      green_interpolated    := green_product + signed(shift_left(resize(green_from, 16), 6));
      red_blue_interpolated := red_blue_product + signed(shift_left(resize(red_blue_from, 17), 6));
      background_green      <= unsigned(green_interpolated(13 downto 6));
      background_red_blue   <= unsigned(red_blue_interpolated(14 downto 6));
      plain_excess          <= signed(shift_left(resize(g_at(2), 11), 1)) - signed(resize(rb_at(2), 11));

      -- 3: its excess, what it costs a clipped pixel, and its part in the sums
      twice_minus := signed(shift_left(resize(background_green, 11), 1)) - signed(resize(background_red_blue, 11));
      if twice_minus < 0 or full_scale_at(3) = '1' then
        background_excess <= (others => '0');
      else
        background_excess <= twice_minus;
      end if;
      excess_4 <= plain_excess;
      lost     <= unsigned(full_and_lowest) * background_green;
      if rb_at(3) > background_red_blue then
        over_4 <= rb_at(3) - background_red_blue;
      else
        over_4 <= (others => '0');
      end if;
      green_share      := shift_left(resize(background_green, 12), 4) + g_at(3) - background_green;
      red_blue_share   := shift_left(resize(background_red_blue, 13), 4) + rb_at(3) - background_red_blue;
      share_green_4    <= green_share(11 downto 4);
      share_red_blue_4 <= red_blue_share(12 downto 4);

      -- 4: excess over the background
      excess_5  <= excess_4 - background_excess;
      full_left := signed("00" & full_weight) - signed(resize(lost(17 downto 8), 11));
      if full_left < 1 then
        left_5 <= to_unsigned(1, 9);
      else
        left_5 <= unsigned(full_left(8 downto 0));
      end if;
      over_5           <= over_4;
      share_green_5    <= share_green_4;
      share_red_blue_5 <= share_red_blue_4;

      -- 5: thresholds
      is_green <= '0';
      if (above_0_at(5) = '1' and excess_5 > signed("00" & cfg_excess_min_0))
        or (above_1_at(5) = '1' and excess_5 > signed("00" & cfg_excess_min_1)) then
        is_green <= '1';
      end if;
      clipped_weight   <= resize(left_5, 10) + over_5;
      difference       := unsigned(excess_5) - unsigned(lowest_excess);
      green_weight     <= difference(9 downto 0);
      share_green_6    <= share_green_5;
      share_red_blue_6 <= share_red_blue_5;

      -- 6: the result
      hit         <= is_green or core_at(6);
      hit_green   <= is_green;
      hit_clipped <= core_at(6) or full_scale_at(6);
      if core_at(6) = '1' or full_scale_at(6) = '1' then
        hit_weight <= std_ulogic_vector(clipped_weight);
      else
        hit_weight <= std_ulogic_vector(green_weight);
      end if;
      if is_green = '1' or core_at(6) = '1' then
        sum_green    <= std_ulogic_vector(share_green_6);
        sum_red_blue <= std_ulogic_vector(share_red_blue_6);
      else
        sum_green    <= std_ulogic_vector(g_at(6));
        sum_red_blue <= std_ulogic_vector(rb_at(6));
      end if;
    end if;
  end process;

end architecture;
