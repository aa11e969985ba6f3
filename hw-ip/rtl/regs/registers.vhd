-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The register block: everything between the bus and the frames.
--
-- Purpose     AXI4-Lite to the registers of karst.rdl, the settings memory and the result memories
-- Consists of axi_lite_slave, karst_regs (generated), counters, settings_memory, settings_load, result_banks,
--             record_memory
-- Latency     see axi_lite_slave; a register is answered at once, a word of a memory 2 clocks later, a counter 2 or 3
-- Throughput  one access at a time
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_regs::model::Registers

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.karst_map_pkg.all;
use work.karst_regs_pkg.all;

entity registers is
  generic (
    G_LASERS : positive range 1 to 720 := 12;  -- most lasers
    G_SLOTS  : positive range 1 to 4 := 4;     -- most spots per laser and camera
    G_PPC    : positive range 1 to 8 := 1      -- pixels per clock, to be told
  );
  port (
    clk              : in  std_ulogic;                       -- rising edge
    rst              : in  std_ulogic;                       -- synchronous, high: forgets everything

    -- AXI4-Lite: as axi_lite_slave
    s_axi_awvalid    : in  std_ulogic;                       -- write address is there
    s_axi_awready    : out std_ulogic;                       -- it is taken if it is there
    s_axi_awaddr     : in  std_ulogic_vector(19 downto 0);   -- byte address
    s_axi_wvalid     : in  std_ulogic;                       -- write data are there
    s_axi_wready     : out std_ulogic;                       -- they are taken if they are there
    s_axi_wdata      : in  std_ulogic_vector(31 downto 0);   -- the data
    s_axi_wstrb      : in  std_ulogic_vector(3 downto 0);    -- bytes to be written
    s_axi_bvalid     : out std_ulogic;                       -- write response is there
    s_axi_bready     : in  std_ulogic;                       -- it is taken if it is there
    s_axi_bresp      : out std_ulogic_vector(1 downto 0);    -- OKAY
    s_axi_arvalid    : in  std_ulogic;                       -- read address is there
    s_axi_arready    : out std_ulogic;                       -- it is taken if it is there
    s_axi_araddr     : in  std_ulogic_vector(19 downto 0);   -- byte address
    s_axi_rvalid     : out std_ulogic;                       -- read response is there
    s_axi_rready     : in  std_ulogic;                       -- it is taken if it is there
    s_axi_rdata      : out std_ulogic_vector(31 downto 0);   -- the data
    s_axi_rresp      : out std_ulogic_vector(1 downto 0);    -- OKAY

    interrupt        : out std_ulogic;                       -- an enabled event has come and was not cleared

    -- Frames: what may happen. Index 0 is camera 1
    configured       : out std_ulogic;                       -- there are settings in use
    enable           : out std_ulogic;                       -- frames are to be taken; never before the first commit
    committing       : out std_ulogic;                       -- no pair of frames may start
    frame_reset      : out std_ulogic;                       -- one clock: forget the frames under way
    frame_idle       : in  std_ulogic;                       -- no frame is under way: see settings_load
    in_frame         : in  std_ulogic_vector(1 downto 0);    -- a frame of the camera is being taken

    -- Frames: what has happened. One clock each; index 0 is camera 1
    event_short_row  : in  std_ulogic_vector(1 downto 0);    -- a row ended before the width
    event_long_row   : in  std_ulogic_vector(1 downto 0);    -- a row went on beyond the width
    event_truncated  : in  std_ulogic_vector(1 downto 0);    -- a frame ended before its last row
    event_stray_row  : in  std_ulogic_vector(1 downto 0);    -- a row came outside a frame
    event_overflow   : in  std_ulogic_vector(1 downto 0);    -- hits were lost for want of slots
    event_stalled    : in  std_ulogic_vector(1 downto 0);    -- a beat had to wait
    event_unpaired   : in  std_ulogic;                       -- a frame had no partner
    event_skipped    : in  std_ulogic;                       -- a frame was not taken because of committing

    cycles           : out std_ulogic_vector(31 downto 0);   -- clocks since the reset

    -- Settings, streamed when a commit takes effect
    commits          : out std_ulogic_vector(31 downto 0);   -- number of the settings in use
    load_valid       : out std_ulogic;                       -- a word of the settings memory
    load_address     : out std_ulogic_vector(15 downto 0);   -- its address in words
    load_data        : out std_ulogic_vector(31 downto 0);   -- the word

    -- Results: records as in karst.rdl, first word in the low bits; a record per clock and memory
    result_write     : in  std_ulogic;                       -- writes a record of the result memory
    result_record    : in  std_ulogic_vector(11 downto 0);   -- 0: frame, 1 and 2: cameras, from 4 on: points
    result_data      : in  std_ulogic_vector(255 downto 0);  -- the record
    spot_1_write     : in  std_ulogic;                       -- writes a spot of camera 1
    spot_1_record    : in  std_ulogic_vector(11 downto 0);   -- index of the spot
    spot_1_data      : in  std_ulogic_vector(255 downto 0);  -- the record
    spot_2_write     : in  std_ulogic;                       -- the same for camera 2
    spot_2_record    : in  std_ulogic_vector(11 downto 0);   -- index of the spot
    spot_2_data      : in  std_ulogic_vector(255 downto 0);  -- the record
    results_done     : in  std_ulogic                        -- one clock, after the last record: the frame is complete
  );
end entity;

architecture rtl of registers is

  constant SETTINGS_WORDS : positive := 256 + 64 * G_LASERS;
  constant RESULT_RECORDS : positive := 4 + G_LASERS;

  -- Reads as zero
  constant NO_REGISTER : std_ulogic_vector(5 downto 0) := "111100";

  -- The two highest bits of an address
  subtype region_t is std_ulogic_vector(1 downto 0);
  constant CONTROL_REGION  : region_t := "00";
  constant SETTINGS_REGION : region_t := "01";
  constant RESULT_REGION   : region_t := "10";
  constant SPOT_REGION     : region_t := "11";

  signal request       : std_ulogic;
  signal is_write      : std_ulogic;
  signal address       : std_ulogic_vector(19 downto 0);
  signal write_data    : std_ulogic_vector(31 downto 0);
  signal write_strobe  : std_ulogic_vector(3 downto 0);
  signal write_mask    : std_ulogic_vector(31 downto 0);
  signal answered      : std_ulogic;
  signal read_data     : std_ulogic_vector(31 downto 0);
  signal region        : region_t;
  signal is_control    : std_ulogic;                 -- a register or a counter
  signal is_register   : std_ulogic;
  signal is_counter    : std_ulogic;
  signal memory_request : std_ulogic;                -- a request to another place comes
  signal memory_answer  : std_ulogic_vector(1 to 2); -- it has come 1 and 2 clocks ago

  signal register_request    : std_ulogic;
  signal register_address    : std_ulogic_vector(5 downto 0);
  signal register_read_done  : std_ulogic;
  signal register_write_done : std_ulogic;
  signal register_data       : std_ulogic_vector(31 downto 0);
  signal registers_in        : karst_registers_in_t;
  signal registers_out       : karst_registers_out_t;

  signal counter_request : std_ulogic;
  signal counter_done    : std_ulogic;
  signal counter_found   : std_ulogic_vector(31 downto 0);

  signal settings_read     : std_ulogic;
  signal settings_write    : std_ulogic;
  signal settings_found    : std_ulogic_vector(31 downto 0);
  signal settings_address  : std_ulogic_vector(15 downto 0);
  signal settings_data     : std_ulogic_vector(31 downto 0);
  signal is_committing     : std_ulogic;
  signal is_configured     : std_ulogic;

  signal results_rst  : std_ulogic;
  signal ready        : std_ulogic;
  signal read_bank    : std_ulogic_vector(1 downto 0);
  signal write_bank   : std_ulogic_vector(1 downto 0);
  signal result_read  : std_ulogic;
  signal spot_1_read  : std_ulogic;
  signal spot_2_read  : std_ulogic;
  signal result_found : std_ulogic_vector(31 downto 0);
  signal spot_1_found : std_ulogic_vector(31 downto 0);
  signal spot_2_found : std_ulogic_vector(31 downto 0);

  signal event_refused   : std_ulogic;
  signal event_committed : std_ulogic;
  signal event_ready     : std_ulogic;
  signal event_missed    : std_ulogic;
  signal event_fault     : std_ulogic;

  signal clocks : unsigned(31 downto 0);

begin

  bus_i : entity work.axi_lite_slave
    generic map (G_ADDRESS_BITS => 20)
    port map (
      clk => clk, rst => rst,
      s_axi_awvalid => s_axi_awvalid, s_axi_awready => s_axi_awready, s_axi_awaddr => s_axi_awaddr,
      s_axi_wvalid => s_axi_wvalid, s_axi_wready => s_axi_wready, s_axi_wdata => s_axi_wdata, s_axi_wstrb => s_axi_wstrb,
      s_axi_bvalid => s_axi_bvalid, s_axi_bready => s_axi_bready, s_axi_bresp => s_axi_bresp,
      s_axi_arvalid => s_axi_arvalid, s_axi_arready => s_axi_arready, s_axi_araddr => s_axi_araddr,
      s_axi_rvalid => s_axi_rvalid, s_axi_rready => s_axi_rready, s_axi_rdata => s_axi_rdata, s_axi_rresp => s_axi_rresp,
      request => request, is_write => is_write, address => address, write_data => write_data,
      write_strobe => write_strobe, answered => answered, read_data => read_data);

  region      <= address(19 downto 18);
  is_control  <= '1' when region = CONTROL_REGION and unsigned(address(17 downto 7)) = 0 else '0';
  is_register <= is_control and not address(6);
  is_counter  <= is_control and address(6);

  mask_g : for byte in 0 to 3 generate
    write_mask(8 * byte + 7 downto 8 * byte) <= (others => write_strobe(byte));
  end generate;

  memory_request <= request and not is_control and not (or memory_answer);

  answer_p : process (clk)
  begin
    if rising_edge(clk) then
      memory_answer <= memory_request & memory_answer(1);
      if rst = '1' then
        memory_answer <= (others => '0');
      end if;
    end if;
  end process;

  answered <= register_read_done or register_write_done or counter_done or memory_answer(2);

  -- What is not asked for is zero
  read_data <= register_data or counter_found or settings_found or result_found or spot_1_found or spot_2_found;

  -- Registers

  register_request <= request and is_register;
  register_address <= address(5 downto 0) when is_register = '1' else NO_REGISTER;

  registers_i : entity work.karst_regs
    port map (
      clk => clk, rst => rst,
      s_cpuif_req => register_request, s_cpuif_req_is_wr => is_write, s_cpuif_addr => register_address,
      s_cpuif_wr_data => write_data, s_cpuif_wr_biten => write_mask,
      s_cpuif_req_stall_wr => open, s_cpuif_req_stall_rd => open,
      s_cpuif_rd_ack => register_read_done, s_cpuif_rd_err => open, s_cpuif_rd_data => register_data,
      s_cpuif_wr_ack => register_write_done, s_cpuif_wr_err => open,
      hwif_in => registers_in, hwif_out => registers_out);

  registers_in.map_hash.value.next_q             <= MAP_HASH_VALUE_RESET;
  registers_in.capacity.lasers.next_q            <= std_ulogic_vector(to_unsigned(G_LASERS, 11));
  registers_in.capacity.slots.next_q             <= std_ulogic_vector(to_unsigned(G_SLOTS, 4));
  registers_in.capacity.pixels_per_clock.next_q  <= std_ulogic_vector(to_unsigned(G_PPC, 4));
  registers_in.status.committing.next_q          <= is_committing;
  registers_in.status.ready.next_q               <= ready;
  registers_in.status.configured.next_q          <= is_configured;
  registers_in.status.frame_1.next_q             <= in_frame(0);
  registers_in.status.frame_2.next_q             <= in_frame(1);
  registers_in.interrupt_status.ready.next_q     <= event_ready;
  registers_in.interrupt_status.committed.next_q <= event_committed;
  registers_in.interrupt_status.fault.next_q     <= event_fault;
  registers_in.fault.short_row_1.hwset           <= event_short_row(0);
  registers_in.fault.long_row_1.hwset            <= event_long_row(0);
  registers_in.fault.truncated_1.hwset           <= event_truncated(0);
  registers_in.fault.stray_row_1.hwset           <= event_stray_row(0);
  registers_in.fault.overflow_1.hwset            <= event_overflow(0);
  registers_in.fault.short_row_2.hwset           <= event_short_row(1);
  registers_in.fault.long_row_2.hwset            <= event_long_row(1);
  registers_in.fault.truncated_2.hwset           <= event_truncated(1);
  registers_in.fault.stray_row_2.hwset           <= event_stray_row(1);
  registers_in.fault.overflow_2.hwset            <= event_overflow(1);
  registers_in.fault.missed.hwset                <= event_missed;
  registers_in.fault.unpaired.hwset              <= event_unpaired;
  registers_in.fault.skipped.hwset               <= event_skipped;
  registers_in.fault.refused.hwset               <= event_refused;
  registers_in.cycles.count.next_q               <= std_ulogic_vector(clocks);

  event_fault <= (or event_short_row) or (or event_long_row) or (or event_truncated) or (or event_stray_row) or
                 (or event_overflow) or event_missed or event_unpaired or event_skipped or event_refused;

  interrupt   <= registers_out.interrupt_status.intr;
  configured  <= is_configured;
  enable      <= registers_out.control.enable.value and is_configured;
  frame_reset <= registers_out.command.reset.value;

  counter_request <= request and is_counter;

  counters_i : entity work.counters
    port map (
      clk => clk, rst => rst, request => counter_request, is_write => is_write, index => address(5 downto 2),
      answered => counter_done, found => counter_found, event_ready => event_ready, event_missed => event_missed,
      event_unpaired => event_unpaired, event_skipped => event_skipped, event_short_row => event_short_row,
      event_long_row => event_long_row, event_truncated => event_truncated, event_stray_row => event_stray_row,
      event_stalled => event_stalled);

  cycles <= std_ulogic_vector(clocks);

  cycles_p : process (clk)
  begin
    if rising_edge(clk) then
      clocks <= clocks + 1;
      if rst = '1' then
        clocks <= (others => '0');
      end if;
    end if;
  end process;

  -- Settings

  settings_read  <= memory_request when region = SETTINGS_REGION else '0';
  settings_write <= memory_answer(2) and is_write and not is_committing when region = SETTINGS_REGION else '0';
  event_refused  <= memory_answer(2) and is_write and is_committing when region = SETTINGS_REGION else '0';
  committing     <= is_committing;

  settings_memory_i : entity work.settings_memory
    generic map (G_WORDS => SETTINGS_WORDS)
    port map (
      clk => clk, bus_read => settings_read, bus_write => settings_write, bus_address => address(17 downto 2), bus_strobe => write_strobe,
      bus_data => write_data, bus_found => settings_found, load_address => settings_address, load_data => settings_data);

  settings_load_i : entity work.settings_load
    generic map (G_WORDS => SETTINGS_WORDS)
    port map (
      clk => clk, rst => rst, commit => registers_out.command.commit.value, frame_idle => frame_idle,
      committing => is_committing, commits => commits, configured => is_configured, event_committed => event_committed,
      memory_address => settings_address, memory_data => settings_data,
      load_valid => load_valid, load_address => load_address, load_data => load_data);

  -- Results

  results_rst <= rst or registers_out.command.reset.value;
  result_read <= memory_request and ready and not address(17) when region = RESULT_REGION else '0';
  spot_1_read <= memory_request and ready and not address(17) when region = SPOT_REGION else '0';
  spot_2_read <= memory_request and ready and address(17) when region = SPOT_REGION else '0';

  banks_i : entity work.result_banks
    port map (
      clk => clk, rst => results_rst, done => results_done, acknowledge => registers_out.command.acknowledge.value,
      ready => ready, read_bank => read_bank, write_bank => write_bank, event_ready => event_ready,
      event_missed => event_missed);

  result_i : entity work.record_memory
    generic map (G_RECORDS => RESULT_RECORDS)
    port map (
      clk => clk, write => result_write, write_bank => write_bank, write_record => result_record,
      write_data => result_data, read => result_read, read_bank => read_bank, read_record => address(16 downto 5),
      read_word => address(4 downto 2), read_data => result_found);

  spot_1_i : entity work.record_memory
    generic map (G_RECORDS => G_LASERS * G_SLOTS)
    port map (
      clk => clk, write => spot_1_write, write_bank => write_bank, write_record => spot_1_record,
      write_data => spot_1_data, read => spot_1_read, read_bank => read_bank, read_record => address(16 downto 5),
      read_word => address(4 downto 2), read_data => spot_1_found);

  spot_2_i : entity work.record_memory
    generic map (G_RECORDS => G_LASERS * G_SLOTS)
    port map (
      clk => clk, write => spot_2_write, write_bank => write_bank, write_record => spot_2_record,
      write_data => spot_2_data, read => spot_2_read, read_bank => read_bank, read_record => address(16 downto 5),
      read_word => address(4 downto 2), read_data => spot_2_found);

end architecture;
