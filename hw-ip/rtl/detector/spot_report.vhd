-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The ordered result stream.
--
-- Purpose     keeps the record of each slot until the end of the frame, then gives those of the slots that hold a spot, laser
--             by laser, slot by slot, and the frame's record behind them
-- Latency     5 from a laser's slots to its first record; the frame's record 5 after the last spot's
-- Throughput  one record per clock, and a clock between two lasers
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_core: SpotDetector::spots

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity spot_report is
  generic (
    G_X_BITS     : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS     : positive range 1 to 11 := 10;  -- highest image: 2 ** this, not above the widest
    G_LASER_BITS : positive range 1 to 10 := 4;   -- most lasers: 2 ** this
    G_SLOT_BITS  : positive range 1 to 3 := 2     -- candidates per laser: 2 ** this
  );
  port (
    clk           : in  std_ulogic;                                        -- rising edge
    rst           : in  std_ulogic;                                        -- synchronous, high: forgets what is under way
    ready         : out std_ulogic;                                        -- the last frame is given: records are welcome
    spot_valid    : in  std_ulogic;                                        -- the spot's record, as the outputs of centroid
    frame_valid   : in  std_ulogic;                                        -- the frame's, which stays until ready
    record_laser  : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    record_slot   : in  std_ulogic_vector(G_SLOT_BITS - 1 downto 0);
    record_data   : in  std_ulogic_vector(255 downto 0);
    mask_valid    : in  std_ulogic;                                        -- slots of a laser, as the outputs of cluster
    mask_laser    : in  std_ulogic_vector(G_LASER_BITS - 1 downto 0);
    mask_slots    : in  std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);
    mask_last     : in  std_ulogic;
    m_axis_tvalid : out std_ulogic;                                        -- record is there, until it is taken
    m_axis_tready : in  std_ulogic;                                        -- record is taken if it is there
    m_axis_tdata  : out std_ulogic_vector(255 downto 0);                   -- the record: see detector
    m_axis_tlast  : out std_ulogic                                         -- the frame's record
  );
end entity;

architecture rtl of spot_report is

  constant SLOTS       : positive := 2 ** G_SLOT_BITS;
  constant COUNT_BITS  : positive := G_X_BITS + G_Y_BITS + 1;
  constant RECORD_BITS : positive := 3 * 25 + 2 * COUNT_BITS + 2 * 16 + 2 * G_Y_BITS + 2 * 16;

  subtype record_t is std_ulogic_vector(RECORD_BITS - 1 downto 0);
  subtype mask_t is std_ulogic_vector(SLOTS - 1 downto 0);

  constant NONE : mask_t := (others => '0');

  -- The bits of a record that are not always zero
  function packed(r : std_ulogic_vector(255 downto 0)) return record_t is
  begin
    return r(255 downto 224) & r(208 + G_Y_BITS - 1 downto 208) & r(192 + G_Y_BITS - 1 downto 192) & r(191 downto 160)
           & r(128 + COUNT_BITS - 1 downto 128) & r(96 + COUNT_BITS - 1 downto 96)
           & r(88 downto 64) & r(56 downto 32) & r(24 downto 0);
  end function;

  function unpacked(p : record_t) return std_ulogic_vector is
    variable r    : std_ulogic_vector(255 downto 0) := (others => '0');
    variable rest : record_t := p;
  begin
    r(24 downto 0)  := p(24 downto 0);
    r(56 downto 32) := p(49 downto 25);
    r(88 downto 64) := p(74 downto 50);
    r(96 + COUNT_BITS - 1 downto 96)   := p(75 + COUNT_BITS - 1 downto 75);
    r(128 + COUNT_BITS - 1 downto 128) := p(75 + 2 * COUNT_BITS - 1 downto 75 + COUNT_BITS);
    r(191 downto 160)                := p(75 + 2 * COUNT_BITS + 31 downto 75 + 2 * COUNT_BITS);
    r(192 + G_Y_BITS - 1 downto 192) := p(107 + 2 * COUNT_BITS + G_Y_BITS - 1 downto 107 + 2 * COUNT_BITS);
    r(208 + G_Y_BITS - 1 downto 208) := p(107 + 2 * COUNT_BITS + 2 * G_Y_BITS - 1 downto 107 + 2 * COUNT_BITS + G_Y_BITS);
    r(255 downto 224)                := p(RECORD_BITS - 1 downto RECORD_BITS - 32);
    return r;
  end function;

  -- At least as deep as a block memory: of a shallower one yosys makes hundreds of LUTs
  constant ADDRESS_BITS : positive := maximum(9, G_LASER_BITS + G_SLOT_BITS);
  type memory_t is array (0 to 2 ** ADDRESS_BITS - 1) of record_t;
  signal memory        : memory_t;
  -- No word is read while it is written: a frame's records are given when all its spots are stored, and before those of the
  -- next frame; its own record is given after it is stored
  attribute no_rw_check : boolean;
  attribute no_rw_check of memory : signal is true;
  signal write_address : unsigned(ADDRESS_BITS - 1 downto 0);
  signal read_address  : unsigned(ADDRESS_BITS - 1 downto 0);
  signal store         : std_ulogic;
  signal fetch         : std_ulogic;
  signal fetched       : record_t;
  signal fetched_valid : std_ulogic;
  signal fetched_last  : std_ulogic;
  signal pass          : std_ulogic;  -- the fetched record goes to the output
  signal given         : record_t;

  -- Lasers that have spots, and the last one
  signal queue_in    : std_ulogic_vector(G_LASER_BITS + SLOTS downto 0);
  signal queue_out   : std_ulogic_vector(G_LASER_BITS + SLOTS downto 0);
  signal queue_write : std_ulogic;
  signal queue_valid : std_ulogic;
  signal queue_ready : std_ulogic;
  signal laser       : std_ulogic_vector(G_LASER_BITS - 1 downto 0);
  signal slots_left  : mask_t;      -- of this laser
  signal this_slot   : mask_t;
  signal is_last     : std_ulogic;  -- this laser is the last one
  signal slot        : unsigned(G_SLOT_BITS - 1 downto 0);

  signal is_busy     : std_ulogic;
  signal has_frame   : std_ulogic;  -- the frame's record is there
  signal spots_given : std_ulogic;  -- all spots are: the frame's record is next
  signal frame_stored : std_ulogic;

begin

  queue_write <= '1' when mask_valid = '1' and (mask_slots /= NONE or mask_last = '1') else '0';
  queue_in    <= mask_last & mask_laser & mask_slots;

  queue_i : entity work.fifo
    generic map (G_WIDTH => G_LASER_BITS + SLOTS + 1, G_LOG2_DEPTH => G_LASER_BITS)
    port map (
      clk       => clk,
      rst       => rst,
      in_valid  => queue_write,
      in_ready  => open,
      in_data   => queue_in,
      room      => open,
      out_valid => queue_valid,
      out_ready => queue_ready,
      out_data  => queue_out
    );

  this_slot <= slots_left and std_ulogic_vector(unsigned(not slots_left) + 1);

  slot_p : process (all)
    variable number : unsigned(G_SLOT_BITS - 1 downto 0);
  begin
    number := (others => '0');
    for i in this_slot'range loop
      if this_slot(i) = '1' then
        number := number or to_unsigned(i, G_SLOT_BITS);
      end if;
    end loop;
    slot <= number;
  end process;

  pass        <= fetched_valid and (m_axis_tready or not m_axis_tvalid);
  fetch       <= (pass or not fetched_valid) and ((or slots_left) or frame_stored);
  queue_ready <= nor slots_left;

  -- The frame's record takes the first place when all spots are given
  store         <= spot_valid or (has_frame and spots_given);
  write_address <= (others => '0') when spots_given = '1' else
                   resize(unsigned(std_ulogic_vector'(record_laser & record_slot)), ADDRESS_BITS);
  read_address  <= (others => '0') when spots_given = '1' or frame_stored = '1' else
                   resize(unsigned(laser) & slot, ADDRESS_BITS);

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      if store = '1' then
        memory(to_integer(write_address)) <= packed(record_data);
      end if;
      if fetch = '1' then
        fetched <= memory(to_integer(read_address));
      end if;
      if pass = '1' then
        given <= fetched;
      end if;
    end if;
  end process;

  control_p : process (clk)
  begin
    if rising_edge(clk) then
      if fetch = '1' then
        fetched_valid <= '1';
        fetched_last  <= frame_stored;
        slots_left    <= slots_left and not this_slot;
      elsif pass = '1' then
        fetched_valid <= '0';
      end if;
      if queue_ready = '1' then
        is_last     <= '0';
        spots_given <= spots_given or is_last;
      end if;
      if queue_valid = '1' and queue_ready = '1' then
        slots_left <= queue_out(SLOTS - 1 downto 0);
        laser      <= queue_out(G_LASER_BITS + SLOTS - 1 downto SLOTS);
        is_last    <= queue_out(G_LASER_BITS + SLOTS);
      end if;
      if pass = '1' then
        m_axis_tvalid <= '1';
        m_axis_tlast  <= fetched_last;
      elsif m_axis_tready = '1' then
        m_axis_tvalid <= '0';
      end if;
      if mask_valid = '1' then
        is_busy <= '1';
      end if;
      if frame_valid = '1' then
        has_frame <= '1';
      end if;
      if has_frame = '1' and spots_given = '1' then
        has_frame    <= '0';
        spots_given  <= '0';
        frame_stored <= '1';
      end if;
      if frame_stored = '1' and fetch = '1' then
        frame_stored <= '0';
        is_busy      <= '0';
      end if;
      if rst = '1' then
        fetched_valid <= '0';
        slots_left    <= (others => '0');
        is_last       <= '0';
        m_axis_tvalid <= '0';
        is_busy       <= '0';
        has_frame     <= '0';
        spots_given   <= '0';
        frame_stored  <= '0';
      end if;
    end if;
  end process;

  ready        <= not is_busy;
  m_axis_tdata <= unpacked(given);

end architecture;
