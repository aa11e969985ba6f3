-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- From a video stream to pixels that know their place, and one mark at the end of every frame.
--
-- Purpose     counts columns and rows; finds rows and frames of a wrong size, and goes on with the next start of frame
-- Rules       A frame starts with tuser. It ends with its last row, or early with the next tuser. A row ends with tlast;
--             pixels beyond the width are dropped and count it as damaged, as a tlast before the width does, and a
--             row without any before the next tuser. Rows outside a frame (before the first tuser, or after the last
--             row) are dropped and told by event_stray_row.
-- Latency     2
-- Throughput  one beat per clock. Each end of frame costs 1 + PAUSE clocks. So that the backgrounds of one row are there
--             before the next one asks for them, a row of less than LONG_ROW pixels is followed by PAUSE clocks
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
  constant PAUSE    : positive := 20;
  -- Pixels of a row that is not followed by a pause: two blocks, and as many as come in PAUSE clocks
  constant LONG_ROW : positive := 128 + PAUSE * G_PPC;

  signal held_valid : std_ulogic;
  signal held_data  : std_ulogic_vector(s_axis_tdata'range);
  signal held_user  : std_ulogic;
  signal held_last  : std_ulogic;
  signal held_void  : std_ulogic;

  signal in_frame     : std_ulogic;
  signal end_pending  : std_ulogic;
  signal is_truncated : std_ulogic;
  signal pausing      : std_ulogic;
  signal pause_left   : unsigned(4 downto 0);
  -- Outside a frame all of these are as at a frame's start
  signal x            : unsigned(G_X_BITS downto 0);
  signal y            : unsigned(G_Y_BITS downto 0);
  signal damaged      : unsigned(G_X_BITS downto 0);
  signal row_open     : std_ulogic;  -- a beat of the row has come
  signal is_full      : std_ulogic;  -- the row has all its pixels
  signal is_long      : std_ulogic;  -- with its next beat the row needs no pause

  signal next_x    : unsigned(G_X_BITS downto 0);  -- x + G_PPC
  signal next_y    : unsigned(G_Y_BITS downto 0);  -- y + 1
  signal last_x    : unsigned(G_X_BITS downto 0);  -- column of a row's last beat
  signal last_y    : unsigned(G_Y_BITS downto 0);  -- the frame's last row
  signal is_last_x : std_ulogic;                   -- x is last_x
  signal is_last_y : std_ulogic;                   -- y is last_y

  signal can_work : std_ulogic;
  signal consume  : std_ulogic;

begin

  can_work      <= room and not pausing and not end_pending;
  -- A start within a frame first ends that frame
  consume       <= held_valid and can_work and not (held_user and in_frame);
  s_axis_tready <= (can_work and not (held_user and in_frame)) or not held_valid;

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
  begin
    if rising_edge(clk) then
      out_valid       <= '0';
      out_end         <= end_pending;
      out_start       <= held_user;
      out_x           <= std_ulogic_vector(x);
      out_y           <= std_ulogic_vector(y);
      out_data        <= held_data;
      event_short_row <= '0';
      event_long_row  <= '0';
      event_truncated <= '0';
      event_stray_row <= '0';
      if end_pending = '1' then
        out_x <= std_ulogic_vector(damaged);
      end if;

      last_x <= unsigned(cfg_width) - G_PPC;
      last_y <= unsigned(cfg_height) - 1;
      if in_frame = '0' then
        is_last_x <= '1' when last_x = 0 else '0';
        is_last_y <= '1' when last_y = 0 else '0';
      end if;

      pause_left <= pause_left - 1;
      if pause_left = 1 then
        pausing <= '0';
      end if;

      if consume = '1' and held_void = '0' then
        if held_user = '1' or in_frame = '1' then
          in_frame  <= '1';
          row_open  <= '1';
          out_valid <= not is_full;
          if is_full = '0' then
            x         <= next_x;
            next_x    <= next_x + G_PPC;
            is_long   <= '1' when next_x >= LONG_ROW - G_PPC else '0';
            is_full   <= is_last_x;
            is_last_x <= '1' when next_x = last_x else '0';
          end if;
          if held_last = '1' then
            row_open  <= '0';
            x         <= (others => '0');
            next_x    <= to_unsigned(G_PPC, next_x'length);
            is_long   <= '0';
            is_full   <= '0';
            is_last_x <= '1' when last_x = 0 else '0';
            y         <= next_y;
            next_y    <= next_y + 1;
            is_last_y <= '1' when next_y = last_y else '0';
            if is_full = '1' or is_last_x = '0' then
              event_long_row  <= is_full;
              event_short_row <= not is_full;
              damaged         <= damaged + 1;
            end if;
            if is_long = '0' then
              pausing    <= '1';
              pause_left <= to_unsigned(PAUSE, pause_left'length);
            end if;
            if is_last_y = '1' then
              in_frame     <= '0';
              end_pending  <= '1';
              is_truncated <= '0';
            end if;
          end if;
        elsif held_last = '1' then
          event_stray_row <= '1';
        end if;
      elsif held_valid = '1' and can_work = '1' and in_frame = '1' then
        -- A start of frame within a frame
        in_frame     <= '0';
        end_pending  <= '1';
        is_truncated <= '1';
        x            <= (others => '0');
        next_x       <= to_unsigned(G_PPC, next_x'length);
        is_long      <= '0';
        is_full      <= '0';
        row_open     <= '0';
        if row_open = '1' then
          y               <= next_y;
          damaged         <= damaged + 1;
          event_long_row  <= is_full;
          event_short_row <= not is_full;
          is_truncated    <= not is_last_y;
        end if;
      end if;

      -- The end comes after a row's own pause
      if end_pending = '1' and pausing = '0' and room = '1' then
        out_valid       <= '1';
        event_truncated <= is_truncated;
        end_pending     <= '0';
        pausing         <= '1';
        pause_left      <= to_unsigned(PAUSE, pause_left'length);
        y               <= (others => '0');
        next_y          <= to_unsigned(1, next_y'length);
        damaged         <= (others => '0');
      end if;

      if rst = '1' then
        out_valid   <= '0';
        in_frame    <= '0';
        end_pending <= '0';
        pausing     <= '0';
        x           <= (others => '0');
        next_x      <= to_unsigned(G_PPC, next_x'length);
        y           <= (others => '0');
        next_y      <= to_unsigned(1, next_y'length);
        damaged     <= (others => '0');
        is_long     <= '0';
        is_full     <= '0';
        row_open    <= '0';
      end if;
    end if;
  end process;

end architecture;
