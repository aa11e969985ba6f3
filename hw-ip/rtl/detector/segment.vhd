-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Segmentation: which pixels of a beat belong to a laser spot, over the background of the rows above.
--
-- Purpose     classifies G_PPC pixels per clock; keeps the mean colour of each block of 64 pixels from every fourth row
-- Latency     11 from in_valid to out_valid; 14 until a block's mean is stored
-- Throughput  one beat per clock, no stall
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_core: Thresholds::scan_row

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity segment is
  generic (
    G_PPC    : positive range 1 to 8 := 1;    -- pixels per clock: 1, 2, 4 or 8
    G_X_BITS : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS : positive range 1 to 11 := 10   -- highest image: 2 ** this
  );
  port (
    clk                : in  std_ulogic;                                 -- rising edge
    rst                : in  std_ulogic;                                 -- synchronous, high: forgets what is under way
    cfg_width          : in  std_ulogic_vector(G_X_BITS downto 0);       -- px, a multiple of G_PPC
    cfg_green_min_0    : in  std_ulogic_vector(7 downto 0);              -- Thresholds::green_min
    cfg_green_min_1    : in  std_ulogic_vector(7 downto 0);
    cfg_excess_min_0   : in  std_ulogic_vector(8 downto 0);              -- Thresholds::excess_min, 0 to 510
    cfg_excess_min_1   : in  std_ulogic_vector(8 downto 0);
    cfg_saturation_min : in  std_ulogic_vector(7 downto 0);              -- Thresholds::saturation_min
    cfg_clip_min       : in  std_ulogic_vector(7 downto 0);              -- Thresholds::clip_min
    cfg_clipped_weight : in  std_ulogic_vector(8 downto 0);              -- Thresholds::clipped_weight; 0 counts as 1, and
                                                                         -- more than 500 as 500
    in_valid           : in  std_ulogic;                                 -- as the outputs of frame_control
    in_end             : in  std_ulogic;
    in_start           : in  std_ulogic;
    in_x               : in  std_ulogic_vector(G_X_BITS downto 0);
    in_y               : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_data            : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);
    out_valid          : out std_ulogic;                                 -- hits, or the end of a frame
    out_end            : out std_ulogic;                                 -- end of a frame
    out_x              : out std_ulogic_vector(G_X_BITS downto 0);       -- column of the first pixel, as in_x
    out_y              : out std_ulogic_vector(G_Y_BITS downto 0);       -- as in_y
    out_hits           : out std_ulogic_vector(13 * G_PPC - 1 downto 0)  -- per pixel: hit, green, clipped, weight (10 bits)
  );
end entity;

architecture rtl of segment is

  constant LANE_BITS  : positive := 13;
  constant BLOCK_BITS : positive := G_X_BITS - 6;
  constant BLOCKS     : positive := 2 ** BLOCK_BITS;

  -- Green and red + blue
  subtype background_t is std_ulogic_vector(16 downto 0);
  constant DARK : background_t := (others => '0');
  type memory_t is array (0 to BLOCKS - 1) of background_t;
  signal memory : memory_t;

  -- No word that matters is read while it is written: a block's mean comes after its end, when the next one is read
  attribute no_rw_check : boolean;
  attribute no_rw_check of memory : signal is true;

  -- Whole blocks of a row: an incomplete last one has no background
  signal whole_blocks : unsigned(BLOCK_BITS downto 0);
  -- Blocks with a background in this frame, from the left; the others count as dark
  signal written      : unsigned(BLOCK_BITS downto 0);
  -- In half blocks from the left: where the last one of these starts to be on the left, too
  signal whole_halves   : unsigned(BLOCK_BITS + 1 downto 0);
  signal written_halves : unsigned(BLOCK_BITS + 1 downto 0);

  -- The background is that of two blocks, interpolated between their middles: of the block whose middle is to the left,
  -- and of the one whose middle is to the right. The latter's index
  signal right_block : unsigned(BLOCK_BITS downto 0);

  -- 1
  signal fetched       : background_t;
  signal is_written_1  : std_ulogic;
  signal has_right_1   : std_ulogic;  -- there is a block to the right
  signal is_inside_1   : std_ulogic;  -- in a whole block
  signal is_middle_1   : std_ulogic;  -- first beat of a block's right half
  signal is_sampled_1  : std_ulogic;  -- counts for the next background
  -- 2
  signal left  : background_t;
  signal right : background_t;
  signal step  : unsigned(6 downto 0);
  -- 3, and 4: the differences are registers beside their subtractions before they are those of the multipliers
  signal from_3, from_4                     : background_t;
  signal slope_green_3, slope_green_4       : signed(8 downto 0);
  signal slope_red_blue_3, slope_red_blue_4 : signed(9 downto 0);
  signal step_3, step_4                     : unsigned(6 downto 0);

  signal lowest_excess   : unsigned(8 downto 0);
  signal full_weight     : unsigned(8 downto 0);
  signal sum_of_limits   : unsigned(9 downto 0);  -- of full_weight and lowest_excess, and 1
  signal full_and_lowest : unsigned(9 downto 0);

  -- Beats on their way. Index: clocks after the input
  constant LAST : positive := 10;
  type x_array_t is array (natural range <>) of unsigned(G_X_BITS downto 0);
  type y_array_t is array (natural range <>) of unsigned(G_Y_BITS downto 0);
  type data_array_t is array (natural range <>) of std_ulogic_vector(24 * G_PPC - 1 downto 0);
  signal valid_at   : std_ulogic_vector(0 to LAST);
  signal end_at     : std_ulogic_vector(0 to LAST);
  signal x_at       : x_array_t(0 to LAST);
  signal y_at       : y_array_t(0 to LAST);
  signal data_at    : data_array_t(0 to 3);
  signal sampled_at : std_ulogic_vector(2 to LAST + 1);

  signal hits : std_ulogic_vector(LANE_BITS * G_PPC - 1 downto 0);

  type green_array_t is array (natural range <>) of std_ulogic_vector(7 downto 0);
  type red_blue_array_t is array (natural range <>) of std_ulogic_vector(8 downto 0);
  signal sums_green    : green_array_t(0 to G_PPC - 1);
  signal sums_red_blue : red_blue_array_t(0 to G_PPC - 1);

  -- Sums of a beat, then of a block
  signal x_11           : unsigned(G_X_BITS - 1 downto 0);
  signal beat_valid     : std_ulogic;
  signal beat_x         : unsigned(G_X_BITS - 1 downto 0);
  signal beat_green     : unsigned(13 downto 0);
  signal beat_red_blue  : unsigned(14 downto 0);
  signal block_done     : std_ulogic;
  signal block_index    : unsigned(BLOCK_BITS - 1 downto 0);
  signal block_green    : unsigned(13 downto 0);
  signal block_red_blue : unsigned(14 downto 0);
  signal mean           : background_t;

begin

  whole_blocks <= unsigned(cfg_width(G_X_BITS downto 6));

  valid_at(0) <= in_valid;
  end_at(0)   <= in_end;
  x_at(0)     <= unsigned(in_x);
  y_at(0)     <= unsigned(in_y);
  data_at(0)  <= in_data;

  delay_p : process (clk)
  begin
    if rising_edge(clk) then
      valid_at(1 to LAST) <= valid_at(0 to LAST - 1);
      end_at(1 to LAST)   <= end_at(0 to LAST - 1);
      x_at(1 to LAST)     <= x_at(0 to LAST - 1);
      y_at(1 to LAST)     <= y_at(0 to LAST - 1);
      data_at(1 to 3)     <= data_at(0 to 2);
      sampled_at          <= is_sampled_1 & sampled_at(2 to LAST);
      if rst = '1' then
        valid_at(1 to LAST) <= (others => '0');
      end if;
    end if;
  end process;

  -- Derived from the configuration, which is constant in a frame
  constants_p : process (clk)
  begin
    if rising_edge(clk) then
      whole_halves  <= (whole_blocks & '0') - 1;
      lowest_excess <= unsigned(cfg_excess_min_1);
      if unsigned(cfg_excess_min_0) < unsigned(cfg_excess_min_1) then
        lowest_excess <= unsigned(cfg_excess_min_0);
      end if;
      full_weight <= unsigned(cfg_clipped_weight) - 1;
      if unsigned(cfg_clipped_weight) = 0 then
        full_weight <= (others => '0');
      elsif unsigned(cfg_clipped_weight) > 500 then
        full_weight <= to_unsigned(499, 9);
      end if;
      -- Two registers: yosys moves one with its addition into the DSP block of one lane, and the others lose it
      sum_of_limits   <= resize(full_weight, 10) + lowest_excess + 1;
      full_and_lowest <= sum_of_limits;
    end if;
  end process;

  -- Block n is on the right from the middle of block n - 1 on
  right_block <= resize(shift_right(resize(x_at(0)(G_X_BITS downto 5), BLOCK_BITS + 2) + 1, 1), BLOCK_BITS + 1);

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      fetched <= memory(to_integer(right_block(BLOCK_BITS - 1 downto 0)));
      if block_done = '1' then
        memory(to_integer(block_index)) <= mean;
      end if;
    end if;
  end process;

  mean <= std_ulogic_vector(block_green(13 downto 6)) & std_ulogic_vector(block_red_blue(14 downto 6));

  backgrounds_p : process (clk)
    variable is_inside : std_ulogic;
  begin
    if rising_edge(clk) then
      -- 1
      is_inside    := '1' when x_at(0)(G_X_BITS downto 6) < whole_blocks else '0';
      is_written_1 <= '0';
      if x_at(0)(G_X_BITS downto 5) < written_halves and in_start = '0' then
        is_written_1 <= '1';
      end if;
      has_right_1  <= '1' when x_at(0)(G_X_BITS downto 5) < whole_halves else '0';
      is_middle_1  <= '1' when in_valid = '1' and x_at(0)(5 downto 0) = 32 else '0';
      is_inside_1  <= is_inside;
      is_sampled_1 <= in_valid and not in_end and is_inside and not (in_y(0) or in_y(1));

      -- 2: the last block is its own neighbour, and so is the first one, by the step: nothing is taken from the left
      if valid_at(1) = '1' then
        if has_right_1 = '1' then
          right <= fetched;
          if is_written_1 = '0' then
            right <= DARK;
          end if;
        end if;
        if is_middle_1 = '1' then
          left <= right;
        end if;
        if is_inside_1 = '0' then
          left  <= DARK;
          right <= DARK;
        end if;
      end if;
      step <= '0' & not x_at(1)(5) & x_at(1)(4 downto 0);
      if x_at(1)(G_X_BITS downto 5) = 0 then
        step <= to_unsigned(64, step'length);
      end if;

      -- 3
      from_3           <= left;
      slope_green_3    <= signed('0' & right(16 downto 9)) - signed('0' & left(16 downto 9));
      slope_red_blue_3 <= signed('0' & right(8 downto 0)) - signed('0' & left(8 downto 0));
      step_3           <= step;

      -- 4
      from_4           <= from_3;
      slope_green_4    <= slope_green_3;
      slope_red_blue_4 <= slope_red_blue_3;
      step_4           <= step_3;

      -- Blocks are written from left to right
      if block_done = '1' and block_index = written then
        written        <= written + 1;
        written_halves <= '0' & block_index & '1';
      end if;
      -- frame_control pauses before a start: no mean of the last frame comes after this
      if in_valid = '1' and in_start = '1' then
        written        <= (others => '0');
        written_halves <= (others => '0');
      end if;
    end if;
  end process;

  lanes_g : for lane in 0 to G_PPC - 1 generate
    signal lane_step : unsigned(6 downto 0);
  begin

    -- The first half block has step 64 in all lanes
    lane_step <= step_4 or to_unsigned(lane, 7) when step_4(6) = '0' else step_4;

    classify_i : entity work.classify
      port map (
        clk                => clk,
        cfg_green_min_0    => cfg_green_min_0,
        cfg_green_min_1    => cfg_green_min_1,
        cfg_excess_min_0   => cfg_excess_min_0,
        cfg_excess_min_1   => cfg_excess_min_1,
        cfg_saturation_min => cfg_saturation_min,
        cfg_clip_min       => cfg_clip_min,
        lowest_excess      => std_ulogic_vector(lowest_excess),
        full_weight        => std_ulogic_vector(full_weight),
        full_and_lowest    => std_ulogic_vector(full_and_lowest),
        red                => data_at(3)(24 * lane + 23 downto 24 * lane + 16),
        green              => data_at(3)(24 * lane + 7 downto 24 * lane),
        blue               => data_at(3)(24 * lane + 15 downto 24 * lane + 8),
        from_green         => from_4(16 downto 9),
        from_red_blue      => from_4(8 downto 0),
        green_slope        => std_ulogic_vector(slope_green_4),
        red_blue_slope     => std_ulogic_vector(slope_red_blue_4),
        step               => std_ulogic_vector(lane_step),
        hit                => hits(LANE_BITS * lane + 12),
        hit_green          => hits(LANE_BITS * lane + 11),
        hit_clipped        => hits(LANE_BITS * lane + 10),
        hit_weight         => hits(LANE_BITS * lane + 9 downto LANE_BITS * lane),
        sum_green          => sums_green(lane),
        sum_red_blue       => sums_red_blue(lane)
      );

  end generate;

  output_p : process (clk)
    variable any_hit : std_ulogic;
  begin
    if rising_edge(clk) then
      any_hit := '0';
      for lane in 0 to G_PPC - 1 loop
        any_hit := any_hit or hits(LANE_BITS * lane + 12);
      end loop;
      out_valid <= valid_at(LAST) and (any_hit or end_at(LAST));
      out_end   <= end_at(LAST);
      out_x     <= std_ulogic_vector(x_at(LAST));
      out_y     <= std_ulogic_vector(y_at(LAST));
      out_hits  <= hits;
      if rst = '1' then
        out_valid <= '0';
      end if;
    end if;
  end process;

  sums_p : process (clk)
    variable green    : unsigned(13 downto 0);
    variable red_blue : unsigned(14 downto 0);
  begin
    if rising_edge(clk) then
      x_11     <= x_at(LAST)(G_X_BITS - 1 downto 0);
      green    := (others => '0');
      red_blue := (others => '0');
      for lane in 0 to G_PPC - 1 loop
        green    := green + unsigned(sums_green(lane));
        red_blue := red_blue + unsigned(sums_red_blue(lane));
      end loop;
      beat_green    <= green;
      beat_red_blue <= red_blue;
      beat_x        <= x_11;
      beat_valid    <= sampled_at(LAST + 1);

      block_done <= '0';
      if beat_valid = '1' then
        if beat_x(5 downto 0) = 0 then
          block_green    <= beat_green;
          block_red_blue <= beat_red_blue;
        else
          block_green    <= block_green + beat_green;
          block_red_blue <= block_red_blue + beat_red_blue;
        end if;
        block_index <= beat_x(G_X_BITS - 1 downto 6);
        if beat_x(5 downto 0) = 64 - G_PPC then
          block_done <= '1';
        end if;
      end if;

      if rst = '1' then
        block_done <= '0';
      end if;
    end if;
  end process;

end architecture;
