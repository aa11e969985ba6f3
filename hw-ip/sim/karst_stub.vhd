-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- In place of the IP: its registers alone. No frame comes. The response codes are a signal that a bench drives.
--
-- Purpose     lets tb_soc run in seconds: the whole IP takes minutes there, and is checked elsewhere
-- Twin        karst_regs::model::Registers

library ieee;
use ieee.std_logic_1164.all;

package karst_stub_pkg is

  signal stub_response : std_ulogic_vector(1 downto 0) := "00";

end package;

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.karst_stub_pkg.all;

entity karst_top is
  generic (
    G_PPC            : positive range 1 to 8 := 1;     -- pixels per clock: 1, 2, 4 or 8
    G_X_BITS         : positive range 7 to 11 := 10;   -- widest image: 2 ** this
    G_Y_BITS         : positive range 1 to 11 := 10;   -- highest image: 2 ** this, not above the widest
    G_LASERS         : positive range 2 to 720 := 12;  -- most lasers
    G_SLOT_BITS      : positive range 1 to 2 := 2;     -- most spots per laser and camera: 2 ** this
    G_BITS_PER_STAGE : positive range 2 to 8 := 4      -- as reconstructor
  );
  port (
    clk              : in  std_ulogic;                                  -- rising edge
    rst              : in  std_ulogic;                                  -- synchronous, high: forgets everything

    -- Pixels of camera 1: AXI4-Stream Video
    s_axis_1_tvalid  : in  std_ulogic;                                  -- beat is there
    s_axis_1_tready  : out std_ulogic;                                  -- it is taken if it is there
    s_axis_1_tdata   : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);  -- pixels, the leftmost in the low bits: R, B, G from
                                                                        -- the high byte down
    s_axis_1_tuser   : in  std_ulogic;                                  -- first beat of a frame
    s_axis_1_tlast   : in  std_ulogic;                                  -- last beat of a row

    -- Pixels of camera 2
    s_axis_2_tvalid  : in  std_ulogic;                                  -- as camera 1
    s_axis_2_tready  : out std_ulogic;
    s_axis_2_tdata   : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);
    s_axis_2_tuser   : in  std_ulogic;
    s_axis_2_tlast   : in  std_ulogic;

    -- Registers: AXI4-Lite, 1 MiB
    s_axi_awvalid    : in  std_ulogic;                                  -- write address is there
    s_axi_awready    : out std_ulogic;                                  -- it is taken if it is there
    s_axi_awaddr     : in  std_ulogic_vector(19 downto 0);              -- byte address
    s_axi_wvalid     : in  std_ulogic;                                  -- write data are there
    s_axi_wready     : out std_ulogic;                                  -- they are taken if they are there
    s_axi_wdata      : in  std_ulogic_vector(31 downto 0);              -- the data
    s_axi_wstrb      : in  std_ulogic_vector(3 downto 0);               -- bytes to be written
    s_axi_bvalid     : out std_ulogic;                                  -- write response is there
    s_axi_bready     : in  std_ulogic;                                  -- it is taken if it is there
    s_axi_bresp      : out std_ulogic_vector(1 downto 0);               -- what the bench says
    s_axi_arvalid    : in  std_ulogic;                                  -- read address is there
    s_axi_arready    : out std_ulogic;                                  -- it is taken if it is there
    s_axi_araddr     : in  std_ulogic_vector(19 downto 0);              -- byte address
    s_axi_rvalid     : out std_ulogic;                                  -- read response is there
    s_axi_rready     : in  std_ulogic;                                  -- it is taken if it is there
    s_axi_rdata      : out std_ulogic_vector(31 downto 0);              -- the data
    s_axi_rresp      : out std_ulogic_vector(1 downto 0);               -- what the bench says

    interrupt        : out std_ulogic                                   -- an enabled event has come and was not cleared
  );
end entity;

architecture sim of karst_top is
begin

  s_axis_1_tready <= '1';
  s_axis_2_tready <= '1';
  s_axi_bresp     <= stub_response;
  s_axi_rresp     <= stub_response;

  registers_i : entity work.registers
    generic map (G_LASERS => G_LASERS, G_SLOTS => 2 ** G_SLOT_BITS, G_PPC => G_PPC)
    port map (
      clk => clk, rst => rst,
      s_axi_awvalid => s_axi_awvalid, s_axi_awready => s_axi_awready, s_axi_awaddr => s_axi_awaddr,
      s_axi_wvalid => s_axi_wvalid, s_axi_wready => s_axi_wready, s_axi_wdata => s_axi_wdata, s_axi_wstrb => s_axi_wstrb,
      s_axi_bvalid => s_axi_bvalid, s_axi_bready => s_axi_bready, s_axi_bresp => open,
      s_axi_arvalid => s_axi_arvalid, s_axi_arready => s_axi_arready, s_axi_araddr => s_axi_araddr,
      s_axi_rvalid => s_axi_rvalid, s_axi_rready => s_axi_rready, s_axi_rdata => s_axi_rdata, s_axi_rresp => open,
      interrupt => interrupt, configured => open, enable => open, committing => open, frame_reset => open,
      frame_idle => '1', in_frame => "00", event_short_row => "00", event_long_row => "00", event_truncated => "00",
      event_stray_row => "00", event_overflow => "00", event_stalled => "00", event_unpaired => '0',
      event_skipped => '0', cycles => open, commits => open, load_valid => open, load_address => open, load_data => open,
      result_write => '0', result_record => (others => '0'), result_data => (others => '0'),
      spot_1_write => '0', spot_1_record => (others => '0'), spot_1_data => (others => '0'),
      spot_2_write => '0', spot_2_record => (others => '0'), spot_2_data => (others => '0'), results_done => '0');

end architecture;
