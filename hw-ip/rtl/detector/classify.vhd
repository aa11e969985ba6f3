-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Class and weight of one pixel, given the background around it.
--
-- Purpose     eq. 2 of the paper over the local background, the saturated core, the weight in the centroid, and what the
--             pixel adds to the background of the next rows
-- Latency     7 from the pixel to hit and 8 to the sums; the background comes one clock after the pixel
-- Throughput  one per clock, no stall. No reset: it has no state
-- Resources   hw-ip/synth/resources.txt
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
    full_weight        : in  std_ulogic_vector(8 downto 0);   -- Thresholds::clipped_weight - 1, 0 to 499
    full_and_lowest    : in  std_ulogic_vector(9 downto 0);   -- Thresholds::clipped_weight and lowest_excess
    red                : in  std_ulogic_vector(7 downto 0);   -- the pixel
    green              : in  std_ulogic_vector(7 downto 0);
    blue               : in  std_ulogic_vector(7 downto 0);
    from_green         : in  std_ulogic_vector(7 downto 0);   -- background at the middle of the block to the left; this and
    from_red_blue      : in  std_ulogic_vector(8 downto 0);   -- the next five are one clock later than the pixel
    green_slope        : in  std_ulogic_vector(8 downto 0);   -- signed: how much more it is in the middle of the block to the
    red_blue_slope     : in  std_ulogic_vector(9 downto 0);   -- right
    step               : in  std_ulogic_vector(6 downto 0);   -- from left to right, of 64
    hit                : out std_ulogic;                      -- the pixel belongs to a spot
    hit_green          : out std_ulogic;                      -- it is green, not only saturated
    hit_clipped        : out std_ulogic;                      -- it is clipped or a core
    hit_weight         : out std_ulogic_vector(9 downto 0);   -- 1 to 1010
    sum_green          : out std_ulogic_vector(7 downto 0);   -- for the next background; one clock after hit
    sum_red_blue       : out std_ulogic_vector(8 downto 0)
  );
end entity;

architecture rtl of classify is

  subtype byte_t is unsigned(7 downto 0);
  subtype red_blue_t is unsigned(8 downto 0);
  subtype excess_t is signed(10 downto 0);
  type byte_array_t is array (natural range <>) of byte_t;
  type red_blue_array_t is array (natural range <>) of red_blue_t;
  type excess_array_t is array (natural range <>) of excess_t;

  -- Index: the stage that reads it
  signal g_at          : byte_array_t(2 to 6);
  signal rb_at         : red_blue_array_t(2 to 6);
  signal core_at       : std_ulogic_vector(2 to 7);
  signal full_scale_at : std_ulogic_vector(2 to 6);
  signal above_0_at    : std_ulogic_vector(2 to 7);
  signal above_1_at    : std_ulogic_vector(2 to 7);
  signal plain_at      : excess_array_t(3 to 5);

  -- The background's green and red + blue
  signal from_green_3       : byte_t;
  signal from_red_blue_3    : red_blue_t;
  signal green_product_3    : signed(16 downto 0);
  signal red_blue_product_3 : signed(17 downto 0);
  signal green_4            : signed(16 downto 0);
  signal red_blue_4         : signed(17 downto 0);
  signal green_at           : byte_array_t(5 to 8);
  signal red_blue_at        : red_blue_array_t(5 to 8);

  signal background_excess_5 : excess_t;
  signal lost_5              : unsigned(17 downto 0);
  signal left_6              : signed(10 downto 0);
  signal excess_6            : excess_t;
  signal more_green_7        : signed(8 downto 0);  -- than the background
  signal more_red_blue_7     : signed(9 downto 0);
  signal more_green_8        : signed(8 downto 0);
  signal more_red_blue_8     : signed(9 downto 0);
  signal passes_0_7          : std_ulogic;
  signal passes_1_7          : std_ulogic;
  signal is_clipped_7        : std_ulogic;
  signal base_7              : unsigned(9 downto 0);
  signal hit_8               : std_ulogic;

begin

  hit <= hit_8;

  stages_p : process (clk)
    variable is_green     : std_ulogic;
    variable green_at_4   : byte_t;
    variable red_at_4     : red_blue_t;
    variable no_excess    : std_ulogic;
    variable left         : unsigned(9 downto 0);
    variable more         : unsigned(9 downto 0);
    variable weight       : unsigned(10 downto 0);
    variable green_share  : signed(8 downto 0);
    variable red_share    : signed(9 downto 0);
  begin
    if rising_edge(clk) then
      g_at(3 to 6)          <= g_at(2 to 5);
      rb_at(3 to 6)         <= rb_at(2 to 5);
      core_at(3 to 7)       <= core_at(2 to 6);
      full_scale_at(3 to 6) <= full_scale_at(2 to 5);
      above_0_at(3 to 7)    <= above_0_at(2 to 6);
      above_1_at(3 to 7)    <= above_1_at(2 to 6);
      plain_at(4 to 5)      <= plain_at(3 to 4);
      green_at(6 to 8)      <= green_at(5 to 7);
      red_blue_at(6 to 8)   <= red_blue_at(5 to 7);

      -- 1: what needs the pixel alone
      g_at(2)  <= unsigned(green);
      rb_at(2) <= resize(unsigned(red), 9) + unsigned(blue);
      core_at(2) <= '1' when unsigned(red) >= unsigned(cfg_saturation_min) and unsigned(green) >= unsigned(cfg_saturation_min)
                             and unsigned(blue) >= unsigned(cfg_saturation_min) else '0';
      full_scale_at(2) <= '1' when unsigned(green) >= unsigned(cfg_clip_min) else '0';
      above_0_at(2)    <= '1' when unsigned(green) > unsigned(cfg_green_min_0) else '0';
      above_1_at(2)    <= '1' when unsigned(green) > unsigned(cfg_green_min_1) else '0';

      -- 2: products of the interpolation
      green_product_3    <= signed('0' & step) * signed(green_slope);
      red_blue_product_3 <= resize(signed('0' & step) * signed(red_blue_slope), 18);
      from_green_3       <= unsigned(from_green);
      from_red_blue_3    <= unsigned(from_red_blue);
      plain_at(3)        <= signed(resize(g_at(2) & '0', 11)) - signed(resize(rb_at(2), 11));

      -- 3: background, with six fraction bits
      green_4    <= green_product_3 + signed(resize(from_green_3 & "000000", 17));
      red_blue_4 <= red_blue_product_3 + signed(resize(from_red_blue_3 & "000000", 18));

      -- 4: its excess, and what it costs a clipped pixel
      green_at_4          := unsigned(green_4(13 downto 6));
      red_at_4            := unsigned(red_blue_4(14 downto 6));
      background_excess_5 <= signed(resize(green_at_4 & '0', 11)) - signed(resize(red_at_4, 11));
      lost_5              <= unsigned(full_and_lowest) * green_at_4;
      green_at(5)         <= green_at_4;
      red_blue_at(5)      <= red_at_4;

      -- 5: excess over the background where that is green and the pixel not at full scale; what a clipped pixel weighs
      no_excess := background_excess_5(10) or full_scale_at(5);
      excess_6  <= plain_at(5) - (background_excess_5 and (10 downto 0 => not no_excess));
      left_6    <= signed("00" & full_weight) - signed(resize(lost_5(17 downto 8), 11));

      -- 6: thresholds; the larger part of the weight; how much brighter than the background
      passes_0_7      <= '1' when excess_6 > signed("00" & cfg_excess_min_0) else '0';
      passes_1_7      <= '1' when excess_6 > signed("00" & cfg_excess_min_1) else '0';
      is_clipped_7    <= core_at(6) or full_scale_at(6);
      left            := unsigned(left_6(9 downto 0)) and (9 downto 0 => not left_6(10));
      base_7          <= left when (core_at(6) or full_scale_at(6)) = '1' else unsigned(excess_6(9 downto 0));
      more_green_7    <= signed('0' & g_at(6)) - signed('0' & green_at(6));
      more_red_blue_7 <= signed('0' & rb_at(6)) - signed('0' & red_blue_at(6));

      -- 7: the result. A clipped pixel: what is left, and one, and how much redder and bluer than the background it is
      is_green := (above_0_at(7) and passes_0_7) or (above_1_at(7) and passes_1_7);
      more     := not unsigned('0' & lowest_excess);
      if is_clipped_7 = '1' then
        more := unsigned(more_red_blue_7) and (9 downto 0 => not more_red_blue_7(9));
      end if;
      weight      := (base_7 & '1') + (more & '1');
      hit_8       <= is_green or core_at(7);
      hit_green   <= is_green;
      hit_clipped <= is_clipped_7;
      hit_weight  <= std_ulogic_vector(weight(10 downto 1));

      -- 8: a hit counts by a sixteenth in the sums, and the background for the rest of it
      more_green_8    <= more_green_7;
      more_red_blue_8 <= more_red_blue_7;
      green_share     := more_green_8;
      red_share       := more_red_blue_8;
      if hit_8 = '1' then
        green_share := resize(more_green_8(8 downto 4), 9);
        red_share   := resize(more_red_blue_8(9 downto 4), 10);
      end if;
      sum_green    <= std_ulogic_vector(green_at(8) + unsigned(green_share(7 downto 0)));
      sum_red_blue <= std_ulogic_vector(red_blue_at(8) + unsigned(red_share(8 downto 0)));
    end if;
  end process;

end architecture;
