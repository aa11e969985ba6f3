-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The sensor's system: a processor with its program, the IP, a serial line, timer and watchdog, and two pins.
--
-- Purpose     pixels of two cameras in, messages of karst-link out, by the firmware's doing
-- Consists of VexRiscv (its variant IMAC, Verilog: not part of this repository), ram, wishbone_bus, wishbone_to_axi_lite,
--             karst_top, peripherals
-- Rules       The watchdog resets everything but the RAM and the register that tells of it.
-- Latency     doc/soc.md: clocks per access
-- Throughput  one instruction per clock at best
-- Resources   VexRiscv about 2600 LUT, 1600 FF, 9 RAMB18, 4 DSP48E1; the rest without the IP about 600 LUT, 12 RAMB36, 2 RAMB18
-- Twin        karst_regs::soc names the addresses

library ieee;
use ieee.std_logic_1164.all;

use work.soc_map_pkg.all;

entity soc is
  generic (
    G_PPC            : positive range 1 to 8 := 1;        -- pixels per clock: 1, 2, 4 or 8
    G_X_BITS         : positive range 7 to 11 := 10;      -- widest image: 2 ** this
    G_Y_BITS         : positive range 1 to 11 := 10;      -- highest image: 2 ** this, not above the widest
    G_LASERS         : positive range 2 to 720 := 12;     -- most lasers
    G_SLOT_BITS      : positive range 1 to 2 := 2;        -- most spots per laser and camera: 2 ** this
    G_CLOCKS_PER_US  : positive range 1 to 65535 := 100;  -- of the time, after a reset
    G_CLOCKS_PER_BIT : positive range 4 to 65535 := 33;   -- of the serial line, after a reset
    G_LOG2_DEPTH     : positive range 1 to 12 := 11;      -- of the buffers of the serial line, bytes
    G_IMAGE          : string := ""                       -- file with the program: see ram
  );
  port (
    clk          : in  std_ulogic;                      -- rising edge
    rst          : in  std_ulogic;                      -- synchronous, high: forgets everything but the program

    uart_rx      : in  std_ulogic;                      -- serial line to the sensor, not synchronous
    uart_tx      : out std_ulogic;                      -- serial line from the sensor
    lasers       : out std_ulogic;                      -- the lasers are on
    trigger      : out std_ulogic;                      -- trigger of the cameras

    -- Pixels: as karst_top
    s_axis_1_tvalid : in  std_ulogic;                                  -- beat of camera 1 is there
    s_axis_1_tready : out std_ulogic;                                  -- it is taken if it is there
    s_axis_1_tdata  : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);  -- pixels, the leftmost in the low bits
    s_axis_1_tuser  : in  std_ulogic;                                  -- first beat of a frame
    s_axis_1_tlast  : in  std_ulogic;                                  -- last beat of a row
    s_axis_2_tvalid : in  std_ulogic;                                  -- the same of camera 2
    s_axis_2_tready : out std_ulogic;
    s_axis_2_tdata  : in  std_ulogic_vector(24 * G_PPC - 1 downto 0);
    s_axis_2_tuser  : in  std_ulogic;
    s_axis_2_tlast  : in  std_ulogic;

    -- Loading the program from outside, while rst is high
    load_write   : in  std_ulogic;                      -- writes a word
    load_address : in  std_ulogic_vector(15 downto 0);  -- its place, in words from the start of the RAM
    load_data    : in  std_ulogic_vector(31 downto 0)   -- the word
  );
end entity;

architecture rtl of soc is

  -- Interrupt lines of the processor
  constant INTERRUPT_KARST : natural := 0;
  constant INTERRUPT_UART  : natural := 1;

  component \VexRiscv\ is
    port (
      \clk\                    : in  std_ulogic;
      \reset\                  : in  std_ulogic;
      \externalResetVector\    : in  std_ulogic_vector(31 downto 0);
      \timerInterrupt\         : in  std_ulogic;
      \softwareInterrupt\      : in  std_ulogic;
      \externalInterruptArray\ : in  std_ulogic_vector(31 downto 0);
      \iBusWishbone_CYC\       : out std_ulogic;
      \iBusWishbone_STB\       : out std_ulogic;
      \iBusWishbone_ACK\       : in  std_ulogic;
      \iBusWishbone_WE\        : out std_ulogic;
      \iBusWishbone_ADR\       : out std_ulogic_vector(29 downto 0);
      \iBusWishbone_DAT_MISO\  : in  std_ulogic_vector(31 downto 0);
      \iBusWishbone_DAT_MOSI\  : out std_ulogic_vector(31 downto 0);
      \iBusWishbone_SEL\       : out std_ulogic_vector(3 downto 0);
      \iBusWishbone_ERR\       : in  std_ulogic;
      \iBusWishbone_CTI\       : out std_ulogic_vector(2 downto 0);
      \iBusWishbone_BTE\       : out std_ulogic_vector(1 downto 0);
      \dBusWishbone_CYC\       : out std_ulogic;
      \dBusWishbone_STB\       : out std_ulogic;
      \dBusWishbone_ACK\       : in  std_ulogic;
      \dBusWishbone_WE\        : out std_ulogic;
      \dBusWishbone_ADR\       : out std_ulogic_vector(29 downto 0);
      \dBusWishbone_DAT_MISO\  : in  std_ulogic_vector(31 downto 0);
      \dBusWishbone_DAT_MOSI\  : out std_ulogic_vector(31 downto 0);
      \dBusWishbone_SEL\       : out std_ulogic_vector(3 downto 0);
      \dBusWishbone_ERR\       : in  std_ulogic;
      \dBusWishbone_CTI\       : out std_ulogic_vector(2 downto 0);
      \dBusWishbone_BTE\       : out std_ulogic_vector(1 downto 0)
    );
  end component;

  -- Inputs, a clock later
  signal outer_rst : std_ulogic;
  signal load      : std_ulogic;
  signal load_to   : std_ulogic_vector(15 downto 0);
  signal load_word : std_ulogic_vector(31 downto 0);

  signal bitten    : std_ulogic;  -- the watchdog's reset
  signal inner_rst : std_ulogic;

  signal timer_interrupt : std_ulogic;
  signal uart_interrupt  : std_ulogic;
  signal karst_interrupt : std_ulogic;
  signal interrupts      : std_ulogic_vector(31 downto 0);

  -- Wishbone, instructions
  signal i_stb      : std_ulogic;
  signal i_adr      : std_ulogic_vector(29 downto 0);
  signal i_cti      : std_ulogic_vector(2 downto 0);
  signal i_ack      : std_ulogic;
  signal i_dat_miso : std_ulogic_vector(31 downto 0);

  -- Wishbone, data
  signal d_stb      : std_ulogic;
  signal d_we       : std_ulogic;
  signal d_adr      : std_ulogic_vector(29 downto 0);
  signal d_sel      : std_ulogic_vector(3 downto 0);
  signal d_cti      : std_ulogic_vector(2 downto 0);
  signal d_dat_mosi : std_ulogic_vector(31 downto 0);
  signal d_ack      : std_ulogic;
  signal d_err      : std_ulogic;
  signal d_dat_miso : std_ulogic_vector(31 downto 0);

  signal ram_stb         : std_ulogic;
  signal ram_ack         : std_ulogic;
  signal ram_err         : std_ulogic;
  signal ram_dat         : std_ulogic_vector(31 downto 0);
  signal karst_stb       : std_ulogic;
  signal karst_ack       : std_ulogic;
  signal karst_err       : std_ulogic;
  signal karst_dat       : std_ulogic_vector(31 downto 0);
  signal peripherals_stb : std_ulogic;
  signal peripherals_ack : std_ulogic;
  signal peripherals_err : std_ulogic;
  signal peripherals_dat : std_ulogic_vector(31 downto 0);

  -- AXI4-Lite to the IP
  signal awvalid : std_ulogic;
  signal awready : std_ulogic;
  signal awaddr  : std_ulogic_vector(19 downto 0);
  signal wvalid  : std_ulogic;
  signal wready  : std_ulogic;
  signal wdata   : std_ulogic_vector(31 downto 0);
  signal wstrb   : std_ulogic_vector(3 downto 0);
  signal bvalid  : std_ulogic;
  signal bready  : std_ulogic;
  signal bresp   : std_ulogic_vector(1 downto 0);
  signal arvalid : std_ulogic;
  signal arready : std_ulogic;
  signal araddr  : std_ulogic_vector(19 downto 0);
  signal rvalid  : std_ulogic;
  signal rready  : std_ulogic;
  signal rdata   : std_ulogic_vector(31 downto 0);
  signal rresp   : std_ulogic_vector(1 downto 0);

begin

  inputs_p : process (clk)
  begin
    if rising_edge(clk) then
      outer_rst <= rst;
      load      <= load_write;
      load_to   <= load_address;
      load_word <= load_data;
    end if;
  end process;

  inner_rst <= outer_rst or bitten;

  interrupts <= (INTERRUPT_KARST => karst_interrupt, INTERRUPT_UART => uart_interrupt, others => '0');

  processor_i : component \VexRiscv\
    port map (
      \clk\ => clk, \reset\ => inner_rst, \externalResetVector\ => PROGRAM_BASE,
      \timerInterrupt\ => timer_interrupt, \softwareInterrupt\ => '0', \externalInterruptArray\ => interrupts,
      \iBusWishbone_CYC\ => open, \iBusWishbone_STB\ => i_stb, \iBusWishbone_ACK\ => i_ack, \iBusWishbone_WE\ => open,
      \iBusWishbone_ADR\ => i_adr, \iBusWishbone_DAT_MISO\ => i_dat_miso, \iBusWishbone_DAT_MOSI\ => open,
      \iBusWishbone_SEL\ => open, \iBusWishbone_ERR\ => '0', \iBusWishbone_CTI\ => i_cti, \iBusWishbone_BTE\ => open,
      \dBusWishbone_CYC\ => open, \dBusWishbone_STB\ => d_stb, \dBusWishbone_ACK\ => d_ack, \dBusWishbone_WE\ => d_we,
      \dBusWishbone_ADR\ => d_adr, \dBusWishbone_DAT_MISO\ => d_dat_miso, \dBusWishbone_DAT_MOSI\ => d_dat_mosi,
      \dBusWishbone_SEL\ => d_sel, \dBusWishbone_ERR\ => d_err, \dBusWishbone_CTI\ => d_cti, \dBusWishbone_BTE\ => open);

  ram_i : entity work.ram
    generic map (
      G_BASE => PROGRAM_BASE, G_WORDS => (PROGRAM_BYTES + DATA_BYTES) / 4, G_IMAGE => G_IMAGE)
    port map (
      clk => clk, rst => inner_rst, i_stb => i_stb, i_adr => i_adr, i_cti => i_cti, i_ack => i_ack, i_dat_miso => i_dat_miso,
      d_stb => ram_stb, d_we => d_we, d_adr => d_adr, d_sel => d_sel, d_cti => d_cti, d_dat_mosi => d_dat_mosi,
      d_ack => ram_ack, d_err => ram_err, d_dat_miso => ram_dat,
      load_write => load, load_address => load_to, load_data => load_word);

  bus_i : entity work.wishbone_bus
    port map (
      clk => clk, rst => inner_rst, stb => d_stb, adr => d_adr, ack => d_ack, err => d_err, dat_miso => d_dat_miso,
      ram_stb => ram_stb, ram_ack => ram_ack, ram_err => ram_err, ram_dat => ram_dat,
      karst_stb => karst_stb, karst_ack => karst_ack, karst_err => karst_err, karst_dat => karst_dat,
      peripherals_stb => peripherals_stb, peripherals_ack => peripherals_ack, peripherals_err => peripherals_err,
      peripherals_dat => peripherals_dat);

  peripherals_i : entity work.peripherals
    generic map (G_CLOCKS_PER_US => G_CLOCKS_PER_US, G_CLOCKS_PER_BIT => G_CLOCKS_PER_BIT, G_LOG2_DEPTH => G_LOG2_DEPTH)
    port map (
      clk => clk, rst => outer_rst, stb => peripherals_stb, we => d_we, adr => d_adr(25 downto 0), dat_mosi => d_dat_mosi,
      ack => peripherals_ack, err => peripherals_err, dat_miso => peripherals_dat, bus_err => d_err,
      timer_interrupt => timer_interrupt, uart_interrupt => uart_interrupt, watchdog_reset => bitten,
      uart_rx => uart_rx, uart_tx => uart_tx, lasers => lasers, trigger => trigger);

  bridge_i : entity work.wishbone_to_axi_lite
    generic map (G_ADDRESS_BITS => 20)
    port map (
      clk => clk, rst => inner_rst, stb => karst_stb, we => d_we, adr => d_adr(17 downto 0), sel => d_sel,
      dat_mosi => d_dat_mosi, ack => karst_ack, err => karst_err, dat_miso => karst_dat,
      m_axi_awvalid => awvalid, m_axi_awready => awready, m_axi_awaddr => awaddr,
      m_axi_wvalid => wvalid, m_axi_wready => wready, m_axi_wdata => wdata, m_axi_wstrb => wstrb,
      m_axi_bvalid => bvalid, m_axi_bready => bready, m_axi_bresp => bresp,
      m_axi_arvalid => arvalid, m_axi_arready => arready, m_axi_araddr => araddr,
      m_axi_rvalid => rvalid, m_axi_rready => rready, m_axi_rdata => rdata, m_axi_rresp => rresp);

  karst_i : entity work.karst_top
    generic map (
      G_PPC => G_PPC, G_X_BITS => G_X_BITS, G_Y_BITS => G_Y_BITS, G_LASERS => G_LASERS, G_SLOT_BITS => G_SLOT_BITS)
    port map (
      clk => clk, rst => inner_rst,
      s_axis_1_tvalid => s_axis_1_tvalid, s_axis_1_tready => s_axis_1_tready, s_axis_1_tdata => s_axis_1_tdata,
      s_axis_1_tuser => s_axis_1_tuser, s_axis_1_tlast => s_axis_1_tlast,
      s_axis_2_tvalid => s_axis_2_tvalid, s_axis_2_tready => s_axis_2_tready, s_axis_2_tdata => s_axis_2_tdata,
      s_axis_2_tuser => s_axis_2_tuser, s_axis_2_tlast => s_axis_2_tlast,
      s_axi_awvalid => awvalid, s_axi_awready => awready, s_axi_awaddr => awaddr,
      s_axi_wvalid => wvalid, s_axi_wready => wready, s_axi_wdata => wdata, s_axi_wstrb => wstrb,
      s_axi_bvalid => bvalid, s_axi_bready => bready, s_axi_bresp => bresp,
      s_axi_arvalid => arvalid, s_axi_arready => arready, s_axi_araddr => araddr,
      s_axi_rvalid => rvalid, s_axi_rready => rready, s_axi_rdata => rdata, s_axi_rresp => rresp,
      interrupt => karst_interrupt);

end architecture;
