-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- From what detectors and reconstructor give to the result memories, a pair of frames at a time.
--
-- Purpose     starts the reconstructor when the masks of both frames of a pair are there; writes the spots' records, the
--             cameras' and the points' in the formats of karst.rdl, then the frame's, and tells that the pair is done
-- Rules       Pairs are done in the order in which they were made, so their banks take turns. Records of frames without
--             a partner are thrown away. Records of the next pair wait until this one is done
-- Latency     3 from the last point, or the later camera's record, to results_done
-- Throughput  a spot of each camera and a point per clock; a camera's record waits for a clock without a point
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_regs::model::Model: give_results

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.karst_map_pkg.all;

entity frame_results is
  generic (
    G_Y_BITS : positive range 1 to 11 := 10  -- as detector
  );
  port (
    clk            : in  std_ulogic;                       -- rising edge
    rst            : in  std_ulogic;                       -- synchronous, high: no pairs
    frame_reset    : in  std_ulogic;                       -- one clock: forget the pairs under way
    -- Everything that follows: index 0 is camera 1

    -- Settings in use
    paper          : in  std_ulogic;                       -- the paper's method: points have no deviation
    lasers         : in  std_ulogic_vector(10 downto 0);   -- how many there are
    commits        : in  std_ulogic_vector(31 downto 0);   -- number of the settings
    height_1       : in  std_ulogic_vector(G_Y_BITS downto 0);  -- rows of a frame
    height_2       : in  std_ulogic_vector(G_Y_BITS downto 0);  -- rows of a frame of camera 2
    cycles         : in  std_ulogic_vector(31 downto 0);   -- clock

    -- Frames that start and end: frame_gate
    pair_start     : in  std_ulogic;                       -- the first frame of a pair starts
    pair_bank      : in  std_ulogic;                       -- the pair's bank
    finish         : in  std_ulogic_vector(1 downto 0);    -- a frame ends
    finish_bank    : in  std_ulogic_vector(1 downto 0);    -- its bank
    pair_done      : out std_ulogic;                       -- one clock: the oldest pair is done

    -- Frames that come out of the detectors: frame_tags
    masked         : in  std_ulogic_vector(1 downto 0);    -- the last mask of a frame
    mask_bank      : in  std_ulogic_vector(1 downto 0);    -- its bank
    mask_paired    : in  std_ulogic_vector(1 downto 0);    -- it is one of a pair
    record_bank    : in  std_ulogic_vector(1 downto 0);    -- bank of the frame that records come of
    record_paired  : in  std_ulogic_vector(1 downto 0);    -- it is one of a pair
    recorded       : out std_ulogic_vector(1 downto 0);    -- its last record is taken

    -- Records: detector
    s_axis_tvalid  : in  std_ulogic_vector(1 downto 0);    -- record is there
    s_axis_tready  : out std_ulogic_vector(1 downto 0);    -- it is taken if it is there
    s_axis_tdata_1 : in  std_ulogic_vector(255 downto 0);  -- record of camera 1
    s_axis_tdata_2 : in  std_ulogic_vector(255 downto 0);  -- record of camera 2
    s_axis_tlast   : in  std_ulogic_vector(1 downto 0);    -- the frame's record

    -- Reconstructor
    start          : out std_ulogic;                       -- make the points of a bank
    start_bank     : out std_ulogic;                       -- which one
    start_ready    : in  std_ulogic;                       -- start is taken if it is there
    point_valid    : in  std_ulogic;                       -- point is there
    point_data     : in  std_ulogic_vector(223 downto 0);  -- as reconstructor
    point_last     : in  std_ulogic;                       -- of the frame's last laser

    -- Result memories: registers
    result_write   : out std_ulogic;                       -- writes a record of the result memory
    result_record  : out std_ulogic_vector(11 downto 0);   -- which one
    result_data    : out std_ulogic_vector(255 downto 0);  -- the record
    spot_write     : out std_ulogic_vector(1 downto 0);    -- writes a spot's record: s_axis_tdata
    spot_1_record  : out std_ulogic_vector(11 downto 0);   -- index of the spot of camera 1
    spot_2_record  : out std_ulogic_vector(11 downto 0);   -- index of the spot of camera 2
    results_done   : out std_ulogic;                       -- one clock: all of them are written
    event_overflow : out std_ulogic_vector(1 downto 0)     -- one clock: hits were lost for want of slots
  );
end entity;

architecture rtl of frame_results is

  -- Records of the result memory
  subtype record_t is std_ulogic_vector(11 downto 0);
  constant FRAME_PLACE  : record_t := x"000";
  constant CAMERA_PLACE : record_t := x"001";  -- of camera 1
  constant POINT_PLACE  : record_t := x"004";  -- of the first laser

  subtype word_t is std_ulogic_vector(31 downto 0);
  type words_t is array (0 to 1) of word_t;
  type spots_t is array (0 to 1) of std_ulogic_vector(255 downto 0);
  type counts_t is array (0 to 1) of unsigned(11 downto 0);
  type heights_t is array (0 to 1) of std_ulogic_vector(G_Y_BITS downto 0);

  -- By bank
  signal numbers : words_t;  -- of the pair
  signal starts  : words_t;  -- clock of the first pixel
  signal ends    : words_t;  -- clock of the last one

  signal pair_count : unsigned(31 downto 0);

  -- The pair that is made
  signal bank       : std_ulogic;
  signal all_masked : std_ulogic_vector(0 to 3);  -- by camera and bank: masks of a frame of a pair are complete
  signal started    : std_ulogic;
  signal pointed    : std_ulogic;                     -- its points are written
  signal counted    : std_ulogic_vector(1 downto 0);  -- its cameras' records are
  signal closing    : std_ulogic;                     -- the frame's record is written
  signal closed     : std_ulogic;

  signal records  : spots_t;
  signal heights  : heights_t;
  signal spots    : counts_t;
  signal ready    : std_ulogic_vector(1 downto 0);
  signal is_ours  : std_ulogic_vector(1 downto 0);  -- the record is of the pair that is made
  signal is_last  : std_ulogic_vector(1 downto 0);  -- the frame's record is taken

  function at(number : std_ulogic) return natural is
  begin
    if number = '1' then
      return 1;
    end if;
    return 0;
  end function;

  -- A point as in karst.rdl
  function point_record(point : std_ulogic_vector(223 downto 0); plain : std_ulogic) return std_ulogic_vector is
    variable found  : std_ulogic_vector(255 downto 0);
    variable status : word_t;
  begin
    status := (others => '0');
    if unsigned(point(204 downto 202)) = 0 then
      status(RESULT_POINT_STATUS_WEIGHTED) := not plain;
      status(RESULT_POINT_STATUS_CAMERA_1) := point(205);
      status(RESULT_POINT_STATUS_SPOT_1)   := point(209 downto 207);
      status(RESULT_POINT_STATUS_CAMERA_2) := point(206);
      status(RESULT_POINT_STATUS_SPOT_2)   := point(212 downto 210);
    else
      -- There is no laser without calibration here
      status(RESULT_POINT_STATUS_OUTCOME) := std_ulogic_vector(unsigned(point(204 downto 202)) + 1);
    end if;
    found               := (others => '0');
    found(223 downto 0) := point(191 downto 0) & status;
    return found;
  end function;

  -- A camera's record as in karst.rdl
  function camera_record(frame : std_ulogic_vector(255 downto 0); height : std_ulogic_vector; count : unsigned)
    return std_ulogic_vector is
    variable found : std_ulogic_vector(255 downto 0);
    variable rows  : word_t;
  begin
    rows                              := (others => '0');
    rows(RESULT_CAMERA_ROWS_TAKEN)    := frame(235 downto 224);
    rows(RESULT_CAMERA_ROWS_DAMAGED)  := frame(251 downto 240);
    if unsigned(frame(239 downto 224)) < unsigned(height) then
      rows(RESULT_CAMERA_ROWS_TRUNCATED) := '1';
    end if;
    found               := (others => '0');
    found(159 downto 0) := std_ulogic_vector(resize(count, 32)) & rows & frame(191 downto 96);
    return found;
  end function;

begin

  records(0) <= s_axis_tdata_1;
  records(1) <= s_axis_tdata_2;
  heights(0) <= height_1;
  heights(1) <= height_2;

  -- Records of the detectors

  cameras_g : for camera in 0 to 1 generate
    is_ours(camera)    <= record_paired(camera) and not counted(camera) when record_bank(camera) = bank else '0';
    is_last(camera)    <= s_axis_tvalid(camera) and ready(camera) and s_axis_tlast(camera);
    spot_write(camera) <= s_axis_tvalid(camera) and is_ours(camera) and not s_axis_tlast(camera);

    spots_p : process (clk)
    begin
      if rising_edge(clk) then
        if spot_write(camera) = '1' then
          spots(camera) <= spots(camera) + 1;
        end if;
        event_overflow(camera) <= '0';
        if is_last(camera) = '1' then
          spots(camera) <= (others => '0');
          if unsigned(records(camera)(191 downto 160)) /= 0 then
            event_overflow(camera) <= '1';
          end if;
        end if;
        if rst = '1' or frame_reset = '1' then
          spots(camera)          <= (others => '0');
          event_overflow(camera) <= '0';
        end if;
      end if;
    end process;

  end generate;

  ready(0)      <= not record_paired(0) or (is_ours(0) and (not s_axis_tlast(0) or not point_valid));
  ready(1)      <= not record_paired(1) or (is_ours(1) and (not s_axis_tlast(1) or
                                                            not (point_valid or (is_ours(0) and is_last(0)))));
  s_axis_tready <= ready;
  recorded      <= is_last;
  spot_1_record <= std_ulogic_vector(spots(0));
  spot_2_record <= std_ulogic_vector(spots(1));

  -- Clocks and numbers of the pairs

  pairs_p : process (clk)
  begin
    if rising_edge(clk) then
      if pair_start = '1' then
        pair_count             <= pair_count + 1;
        numbers(at(pair_bank)) <= std_ulogic_vector(pair_count + 1);
        starts(at(pair_bank))  <= cycles;
      end if;
      for camera in 0 to 1 loop
        if finish(camera) = '1' then
          ends(at(finish_bank(camera))) <= cycles;
        end if;
      end loop;
      if rst = '1' then
        pair_count <= (others => '0');
      end if;
    end if;
  end process;

  -- The pair that is made

  start      <= all_masked(at(bank)) and all_masked(2 + at(bank)) and not started;
  start_bank <= bank;
  closing    <= pointed and counted(0) and counted(1) and not closed and not results_done;
  pair_done  <= results_done;

  make_p : process (clk)
  begin
    if rising_edge(clk) then
      for camera in 0 to 1 loop
        if masked(camera) = '1' and mask_paired(camera) = '1' then
          all_masked(2 * camera + at(mask_bank(camera))) <= '1';
        end if;
      end loop;

      result_write  <= '0';
      result_record <= std_ulogic_vector(unsigned(point_data(201 downto 192)) + unsigned(POINT_PLACE));
      result_data   <= point_record(point_data, paper);
      if point_valid = '1' then
        result_write <= '1';
        pointed      <= point_last;
      elsif closing = '1' then
        result_write  <= '1';
        result_record <= FRAME_PLACE;
        result_data   <= (others => '0');
        result_data(159 downto 0) <= std_ulogic_vector(unsigned(cycles) - unsigned(ends(at(bank))) + 2) &
                                     std_ulogic_vector(unsigned(ends(at(bank))) - unsigned(starts(at(bank)))) &
                                     std_ulogic_vector(resize(unsigned(lasers), 32)) & commits & numbers(at(bank));
      else
        for camera in 1 downto 0 loop
          if is_last(camera) = '1' and is_ours(camera) = '1' then
            result_write  <= '1';
            result_record <= std_ulogic_vector(unsigned(CAMERA_PLACE) + camera);
            result_data   <= camera_record(records(camera), heights(camera), spots(camera));
          end if;
        end loop;
      end if;

      for camera in 0 to 1 loop
        if is_last(camera) = '1' and is_ours(camera) = '1' then
          counted(camera) <= '1';
        end if;
      end loop;
      if start = '1' and start_ready = '1' then
        started                   <= '1';
        all_masked(at(bank))      <= '0';
        all_masked(2 + at(bank))  <= '0';
      end if;

      closed       <= closing;
      results_done <= closed;
      if results_done = '1' then
        bank    <= not bank;
        started <= '0';
        pointed <= '0';
        counted <= "00";
      end if;

      if rst = '1' or frame_reset = '1' then
        bank         <= '0';
        all_masked   <= (others => '0');
        started      <= '0';
        pointed      <= '0';
        counted      <= "00";
        closed       <= '0';
        results_done <= '0';
        result_write <= '0';
      end if;
    end if;
  end process;

end architecture;
