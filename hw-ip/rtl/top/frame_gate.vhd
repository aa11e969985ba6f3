-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Which frames of the two cameras the detectors get.
--
-- Purpose     passes or swallows whole frames in front of the detectors, and finds the frames of both cameras that are a pair
-- Rules       Two frames are a pair if the second one starts before half of the first one's rows are there. A pair is taken
--             or not as a whole, as decided when the first of its frames starts: not without enable, and not while
--             committing. A frame ends with its last row, or early with the next start. Rows outside a frame are swallowed.
--             So that the end of a frame is known behind the gate even if the next one is not taken, the first beat of that
--             one comes out marked as void: no pixel, but the end of the frame before it.
--             The two frames of a pair have one bank, the next pair has the other one. A frame waits for its start while the
--             camera's last but one is under way, and while both banks are those of pairs under way.
--             If both cameras start at the same clock, camera 1 comes first and camera 2 one clock later. A frame has more
--             than one beat.
-- Latency     1
-- Throughput  a beat per clock and camera
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_regs::model::Model: row, start_frame, end_frame

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity frame_gate is
  generic (
    G_DATA_BITS : positive range 1 to 192 := 24;  -- of a beat
    G_Y_BITS    : positive range 1 to 11 := 10    -- highest image: 2 ** this
  );
  port (
    clk            : in  std_ulogic;                                   -- rising edge
    rst            : in  std_ulogic;                                   -- synchronous, high: no frames
    -- Everything that follows: index 0 and the low bits are camera 1

    -- What may happen
    configured     : in  std_ulogic;                                   -- there are settings: without, no frame is known
    enable         : in  std_ulogic;                                   -- frames are to be taken; only if configured
    committing     : in  std_ulogic;                                   -- no pair may start
    frame_reset    : in  std_ulogic;                                   -- one clock: the frames under way are not taken any more
    height_1       : in  std_ulogic_vector(G_Y_BITS downto 0);         -- rows of a frame
    height_2       : in  std_ulogic_vector(G_Y_BITS downto 0);         -- rows of a frame of camera 2
    room           : in  std_ulogic_vector(1 downto 0);                -- a frame more of the camera may be taken
    pair_done      : in  std_ulogic;                                   -- one clock: the results of the oldest pair are there

    -- Pixels: AXI4-Stream Video
    s_axis_tvalid  : in  std_ulogic_vector(1 downto 0);                -- beat is there
    s_axis_tready  : out std_ulogic_vector(1 downto 0);                -- it is taken if it is there
    s_axis_tdata   : in  std_ulogic_vector(2 * G_DATA_BITS - 1 downto 0);
    s_axis_tuser   : in  std_ulogic_vector(1 downto 0);                -- first beat of a frame
    s_axis_tlast   : in  std_ulogic_vector(1 downto 0);                -- last beat of a row

    -- Pixels of the frames that are taken
    m_axis_tvalid  : out std_ulogic_vector(1 downto 0);                -- beat is there
    m_axis_tready  : in  std_ulogic_vector(1 downto 0);                -- it is taken if it is there
    m_axis_tdata   : out std_ulogic_vector(2 * G_DATA_BITS - 1 downto 0);
    m_axis_tuser   : out std_ulogic_vector(1 downto 0);                -- first beat of a frame
    m_axis_tlast   : out std_ulogic_vector(1 downto 0);                -- last beat of a row
    m_axis_void    : out std_ulogic_vector(1 downto 0);                -- with tuser: the frame before it ends, no frame starts

    -- Frames that are taken: at the clock at which the beat is taken
    start          : out std_ulogic_vector(1 downto 0);                -- a frame starts
    start_bank     : out std_ulogic_vector(1 downto 0);                -- its bank
    start_first    : out std_ulogic;                                   -- the one that starts is the first one of its pair
    finish         : out std_ulogic_vector(1 downto 0);                -- a frame ends; before the start of the same clock
    finish_bank    : out std_ulogic_vector(1 downto 0);                -- its bank
    finish_paired  : out std_ulogic_vector(1 downto 0);                -- it was one of a pair
    in_frame       : out std_ulogic_vector(1 downto 0);                -- a frame is under way
    idle           : out std_ulogic;                                   -- no frame and no pair is

    -- Events: one clock each
    event_stray    : out std_ulogic_vector(1 downto 0);                -- a row came outside a frame
    event_unpaired : out std_ulogic;                                   -- a frame has ended without a partner
    event_skipped  : out std_ulogic                                    -- a frame was not taken because of committing
  );
end entity;

architecture rtl of frame_gate is

  subtype rows_t is unsigned(G_Y_BITS downto 0);
  type rows_array_t is array (0 to 1) of rows_t;
  subtype flags_t is std_ulogic_vector(1 downto 0);

  signal height : rows_array_t;

  -- The camera's last frame
  signal is_open : flags_t;       -- it has not ended
  signal taken   : flags_t;       -- its pixels pass
  signal paired  : flags_t;       -- the other camera's frame of the pair has started
  signal bank    : flags_t;
  signal rows    : rows_array_t;  -- complete ones

  signal pair_bank : std_ulogic;                 -- of the last pair of which both frames have started
  signal pairs     : unsigned(1 downto 0);       -- such pairs without results yet

  signal starts      : flags_t;  -- a first beat of a frame is taken
  signal row_ends    : flags_t;  -- a last beat of a row is taken
  signal is_partner  : flags_t;  -- the frame that starts is a partner of the other camera's
  signal takes       : flags_t;  -- it is taken
  signal new_bank    : flags_t;
  signal now_taken   : flags_t;  -- of the frame that the beat belongs to
  signal now_paired  : flags_t;
  signal now_rows    : rows_array_t;
  signal frame_ends  : flags_t;  -- with its last row
  signal passes      : flags_t;  -- the beat comes out
  signal may_start   : flags_t;
  signal slot_free   : flags_t;
  signal beat_taken  : flags_t;
  signal frame_taken : flags_t;  -- a frame is under way that is taken
  signal held        : flags_t;  -- a beat is there
  signal alone       : flags_t;  -- a frame ends that has no partner
  signal untold      : std_ulogic;  -- of one of them

begin

  height(0) <= unsigned(height_1);
  height(1) <= unsigned(height_2);

  frame_taken   <= is_open and taken;
  in_frame      <= frame_taken;
  m_axis_tvalid <= held;
  idle          <= not (or frame_taken) and not (or held) when pairs = 0 else '0';

  -- Camera 2 starts after camera 1
  may_start(0) <= room(0) and not pairs(1);
  may_start(1) <= room(1) and not pairs(1) and not starts(0);

  cameras_g : for camera in 0 to 1 generate
    constant OTHER : natural := 1 - camera;
  begin

    slot_free(camera)     <= m_axis_tready(camera) or not held(camera);
    s_axis_tready(camera) <= slot_free(camera) and may_start(camera) when s_axis_tuser(camera) = '1' else
                             slot_free(camera) or not frame_taken(camera);
    beat_taken(camera)    <= s_axis_tvalid(camera) and s_axis_tready(camera);
    starts(camera)        <= beat_taken(camera) and s_axis_tuser(camera);
    row_ends(camera)      <= beat_taken(camera) and s_axis_tlast(camera);

    -- A frame that starts
    is_partner(camera) <= is_open(OTHER) and not paired(OTHER) when rows(OTHER) < shift_right(height(OTHER) + 1, 1) else '0';
    takes(camera)      <= taken(OTHER) when is_partner(camera) = '1' else enable and not committing;
    new_bank(camera)   <= bank(OTHER) when is_partner(camera) = '1' else not pair_bank;

    -- The frame of this beat
    now_taken(camera)  <= takes(camera) when s_axis_tuser(camera) = '1' else frame_taken(camera);
    now_paired(camera) <= is_partner(camera) when s_axis_tuser(camera) = '1' else
                          paired(camera) or (starts(OTHER) and is_partner(OTHER));
    now_rows(camera)   <= (others => '0') when s_axis_tuser(camera) = '1' else rows(camera);
    frame_ends(camera) <= row_ends(camera) and (s_axis_tuser(camera) or is_open(camera))
                          when now_rows(camera) + 1 >= height(camera) else '0';

    -- The first beat of a frame that is not taken ends the one before it
    passes(camera) <= (now_taken(camera) or (s_axis_tuser(camera) and frame_taken(camera))) and beat_taken(camera);

    start(camera)         <= starts(camera) and takes(camera);
    start_bank(camera)    <= new_bank(camera);
    finish(camera)        <= (starts(camera) and frame_taken(camera)) or (frame_ends(camera) and now_taken(camera));
    finish_bank(camera)   <= bank(camera);
    finish_paired(camera) <= paired(camera) when starts(camera) = '1' else now_paired(camera);

    frame_p : process (clk)
    begin
      if rising_edge(clk) then
        event_stray(camera) <= row_ends(camera) and not s_axis_tuser(camera) and not is_open(camera) and enable;

        if slot_free(camera) = '1' then
          held(camera) <= passes(camera);
          m_axis_tdata(G_DATA_BITS * (camera + 1) - 1 downto G_DATA_BITS * camera) <=
            s_axis_tdata(G_DATA_BITS * (camera + 1) - 1 downto G_DATA_BITS * camera);
          m_axis_tuser(camera) <= s_axis_tuser(camera);
          m_axis_tlast(camera) <= s_axis_tlast(camera);
          m_axis_void(camera)  <= s_axis_tuser(camera) and not now_taken(camera);
        end if;

        if starts(camera) = '1' then
          is_open(camera) <= '1';
          taken(camera)   <= takes(camera);
          bank(camera)    <= new_bank(camera);
          rows(camera)    <= (others => '0');
        end if;
        if beat_taken(camera) = '1' then
          paired(camera) <= now_paired(camera);
        elsif starts(OTHER) = '1' and is_partner(OTHER) = '1' then
          paired(camera) <= '1';
        end if;
        if row_ends(camera) = '1' then
          rows(camera) <= now_rows(camera) + 1;
          if frame_ends(camera) = '1' then
            is_open(camera) <= '0';
          end if;
        end if;

        if frame_reset = '1' then
          held(camera)  <= '0';
          taken(camera) <= '0';
        end if;
        if configured = '0' then
          is_open(camera) <= '0';
        end if;
        if rst = '1' then
          held(camera)        <= '0';
          is_open(camera)     <= '0';
          event_stray(camera) <= '0';
        end if;
      end if;
    end process;

  end generate;

  start_first <= (start(0) and not is_partner(0)) or (start(1) and not is_partner(1));

  alone <= finish and not finish_paired;

  events_p : process (clk)
  begin
    if rising_edge(clk) then
      event_skipped <= (or (starts and not takes)) and enable and committing;
      -- Of two at the same clock the second one is told a clock later
      event_unpaired <= alone(0) or alone(1) or untold;
      untold         <= alone(0) and (alone(1) or untold);
      if rst = '1' then
        event_skipped  <= '0';
        event_unpaired <= '0';
        untold         <= '0';
      end if;
    end if;
  end process;

  pairs_p : process (clk)
    variable joins : std_ulogic;
  begin
    if rising_edge(clk) then
      joins := '0';
      for camera in 0 to 1 loop
        if start(camera) = '1' and is_partner(camera) = '1' then
          joins     := '1';
          pair_bank <= new_bank(camera);
        end if;
      end loop;
      if joins = '1' and pair_done = '0' then
        pairs <= pairs + 1;
      elsif joins = '0' and pair_done = '1' then
        pairs <= pairs - 1;
      end if;
      if rst = '1' or frame_reset = '1' then
        pairs     <= (others => '0');
        pair_bank <= '1';
      end if;
    end if;
  end process;

end architecture;
