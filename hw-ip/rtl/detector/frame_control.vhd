-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- From a video stream to pixels that know their place, and one mark at the end of every frame.
--
-- Purpose     counts columns and rows; finds rows and frames of a wrong size, and goes on with the next start of frame
-- Rules       A frame starts with tuser. It ends with its last row, or early with the next tuser. A row ends with tlast;
--             pixels beyond the width are dropped and count it as damaged, as a tlast before the width does. Rows outside
--             a frame (before the first tuser, or after the last row) are dropped and told by event_stray_row.
-- Latency     2
-- Throughput  one beat per clock. Each end of frame costs 1 + PAUSE clocks. So that the backgrounds of one row are there
--             before the next one asks for them, a row of less than two blocks and PAUSE clocks is followed by PAUSE
--             clocks
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_core::SpotDetector::{start_frame, row, end_frame}

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity frame_control is
  generic (
    G_PPC    : positive range 1 to 8 := 1;     -- pixels per clock: 1, 2, 4 or 8
    G_X_BITS : positive range 7 to 11 := 10;   -- widest image: 2 ** this
    G_Y_BITS : positive range 1 to 11 := 10    -- highest image: 2 ** this, not above the widest
  );
  port (
    clk             : in  std_ulogic;                                 -- rising edge
    rst             : in  std_ulogic;                                 -- synchronous, high: waits for a start of frame
    cfg_width       : in  std_ulogic_vector(G_X_BITS downto 0);       -- px, a multiple of G_PPC; constant in a frame
    cfg_height      : in  std_ulogic_vector(G_Y_BITS downto 0);       -- px; constant in a frame
    s_axis_tvalid   : in  std_ulogic;                                 -- beat is there
    s_axis_tready   : out std_ulogic;                                 -- beat is taken if it is there
    s_axis_tdata    : in  std_ulogic_vector(24 * G_PPC - 1 downto 0); -- pixels, the leftmost in the low bits: R, B, G from
                                                                      -- the high byte down
    s_axis_tuser    : in  std_ulogic;                                 -- first beat of a frame
    s_axis_tlast    : in  std_ulogic;                                 -- last beat of a row
    s_axis_void     : in  std_ulogic := '0';                          -- with tuser: ends the frame under way, starts none
    room            : in  std_ulogic;                                 -- the blocks behind have room for a beat
    out_valid       : out std_ulogic;                                 -- pixels, or the end of a frame
    out_end         : out std_ulogic;                                 -- end of a frame
    out_start       : out std_ulogic;                                 -- first beat of a frame
    out_x           : out std_ulogic_vector(G_X_BITS downto 0);       -- column of the first pixel; at the end: damaged rows,
                                                                      -- 2 ** (G_X_BITS + 1) - 1 at most
    out_y           : out std_ulogic_vector(G_Y_BITS downto 0);       -- row; at the end: rows taken
    out_data        : out std_ulogic_vector(24 * G_PPC - 1 downto 0); -- as s_axis_tdata
    event_short_row : out std_ulogic;                                 -- one clock: a row ended before the width
    event_long_row  : out std_ulogic;                                 -- one clock: a row ended after the width
    event_truncated : out std_ulogic;                                 -- one clock: a frame ended before its height
    event_stray_row : out std_ulogic                                  -- one clock: a row ended outside a frame
  );
end entity;

architecture rtl of frame_control is

  -- More than the stages of segment
  constant PAUSE           : positive := 20;
  constant BLOCK_BEATS     : positive := 64 / G_PPC;
  constant LONG_ROW_BEATS  : positive := 2 * BLOCK_BEATS + PAUSE;

  signal held_valid : std_ulogic;
  signal held_data  : std_ulogic_vector(s_axis_tdata'range);
  signal held_user  : std_ulogic;
  signal held_last  : std_ulogic;
  signal held_void  : std_ulogic;

  signal in_frame    : std_ulogic;
  signal end_pending : std_ulogic;
  signal pausing     : std_ulogic;
  signal pause_left  : natural range 0 to PAUSE - 1;
  signal x           : unsigned(G_X_BITS downto 0);
  signal y           : unsigned(G_Y_BITS downto 0);
  signal damaged     : unsigned(G_X_BITS downto 0);
  signal row_open    : std_ulogic;  -- a beat of the row has come
  signal is_long     : std_ulogic;  -- a beat beyond the width has come
  signal row_beats   : natural range 0 to LONG_ROW_BEATS;

  signal can_work : std_ulogic;
  signal consume  : std_ulogic;

begin

  can_work      <= room and not pausing and not end_pending;
  -- A start within a frame first ends that frame
  consume       <= held_valid and can_work and not (held_user and in_frame);
  s_axis_tready <= consume or not held_valid;

  hold_p : process (clk)
  begin
    if rising_edge(clk) then
      if s_axis_tready = '1' then
        held_valid <= s_axis_tvalid;
        held_data  <= s_axis_tdata;
        held_user  <= s_axis_tuser;
        held_last  <= s_axis_tlast;
        held_void  <= s_axis_void;
      end if;
      if rst = '1' then
        held_valid <= '0';
      end if;
    end if;
  end process;

  control_p : process (clk)
    variable column  : unsigned(x'range);
    variable row     : unsigned(y'range);
    variable is_beyond : boolean;
  begin
    if rising_edge(clk) then
      out_valid       <= '0';
      out_end         <= '0';
      out_start       <= '0';
      out_data        <= held_data;
      event_short_row <= '0';
      event_long_row  <= '0';
      event_truncated <= '0';
      event_stray_row <= '0';

      if pausing = '1' then
        if pause_left = 0 then
          pausing <= '0';
        else
          pause_left <= pause_left - 1;
        end if;
      elsif end_pending = '1' then
        out_end <= '1';
        out_x   <= std_ulogic_vector(damaged);
        out_y   <= std_ulogic_vector(y);
        if room = '1' then
          out_valid   <= '1';
          end_pending <= '0';
          pausing     <= '1';
          pause_left  <= PAUSE - 1;
          if y < unsigned(cfg_height) then
            event_truncated <= '1';
          end if;
        end if;
      elsif consume = '1' and held_void = '0' then
        column    := x;
        row       := y;
        is_beyond := is_long = '1';
        if held_user = '1' then
          column    := (others => '0');
          row       := (others => '0');
          is_beyond := false;
          in_frame  <= '1';
          damaged   <= (others => '0');
          row_beats <= 0;
        end if;
        out_x     <= std_ulogic_vector(column);
        out_y     <= std_ulogic_vector(row);
        out_start <= held_user;
        y         <= row;
        if held_user = '1' or in_frame = '1' then
          if column < unsigned(cfg_width) then
            out_valid <= '1';
            column    := column + G_PPC;
          else
            is_beyond := true;
          end if;
          row_open <= '1';
          x        <= column;
          is_long  <= '1' when is_beyond else '0';
          if held_user = '0' and row_beats < LONG_ROW_BEATS then
            row_beats <= row_beats + 1;
          end if;
          if held_last = '1' then
            row_open  <= '0';
            x         <= (others => '0');
            is_long   <= '0';
            row_beats <= 0;
            y         <= row + 1;
            if is_beyond or column /= unsigned(cfg_width) then
              event_long_row  <= '1' when is_beyond else '0';
              event_short_row <= '0' when is_beyond else '1';
              damaged         <= damaged + 1;
              if held_user = '1' then
                damaged <= to_unsigned(1, damaged'length);
              end if;
            end if;
            if row_beats < LONG_ROW_BEATS or held_user = '1' then
              pausing    <= '1';
              pause_left <= PAUSE - 1;
            end if;
            if row + 1 = unsigned(cfg_height) then
              in_frame    <= '0';
              end_pending <= '1';
            end if;
          end if;
        elsif held_last = '1' then
          event_stray_row <= '1';
        end if;
      elsif held_valid = '1' and can_work = '1' and in_frame = '1' then
        -- A start of frame within a frame
        in_frame    <= '0';
        end_pending <= '1';
        x           <= (others => '0');
        is_long     <= '0';
        row_beats   <= 0;
        row_open    <= '0';
        if row_open = '1' then
          y               <= y + 1;
          damaged         <= damaged + 1;
          event_short_row <= '1';
        end if;
      end if;

      if rst = '1' then
        out_valid   <= '0';
        in_frame    <= '0';
        end_pending <= '0';
        pausing     <= '0';
        x           <= (others => '0');
        y           <= (others => '0');
        is_long     <= '0';
        row_open    <= '0';
        row_beats   <= 0;
      end if;
    end if;
  end process;

end architecture;
