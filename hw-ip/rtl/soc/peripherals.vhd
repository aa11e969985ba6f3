-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The processor's peripherals.
--
-- Purpose     Wishbone to the peripheral registers of soc.rdl
-- Consists of uart, timer_watchdog
-- Rules       An access is of a whole word: byte strobes are not looked at. What is not there reads as zero, and is an error.
-- Latency     1 from a request to its acknowledgement
-- Throughput  one access per 2 clocks
-- Resources   hw-ip/synth/resources.txt
-- Twin        none: karst_regs::soc names the registers

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.soc_map_pkg.all;

entity peripherals is
  generic (
    G_CLOCKS_PER_US  : positive range 1 to 65535 := 100;  -- after a reset
    G_CLOCKS_PER_BIT : positive range 4 to 65535 := 33;   -- of the serial line, after a reset
    G_LOG2_DEPTH     : positive range 1 to 12 := 11       -- of each of its buffers, bytes
  );
  port (
    clk             : in  std_ulogic;                      -- rising edge
    rst             : in  std_ulogic;                      -- synchronous, high: forgets everything

    -- Wishbone
    stb             : in  std_ulogic;                      -- a request, until it is acknowledged
    we              : in  std_ulogic;                      -- it is a write
    adr             : in  std_ulogic_vector(25 downto 0);  -- address of the word
    dat_mosi        : in  std_ulogic_vector(31 downto 0);  -- the word to be written
    ack             : out std_ulogic;                      -- it is done
    err             : out std_ulogic;                      -- with ack: there is no such register
    dat_miso        : out std_ulogic_vector(31 downto 0);  -- the word read

    bus_err         : in  std_ulogic;                      -- one clock: an access of the processor, to whatever, has failed

    timer_interrupt : out std_ulogic;                      -- the time has come
    uart_interrupt  : out std_ulogic;                      -- the serial line has what software waits for
    watchdog_reset  : out std_ulogic;                      -- one clock: resets everything, this block included

    uart_rx         : in  std_ulogic;                      -- serial line, not synchronous
    uart_tx         : out std_ulogic;                      -- serial line
    lasers          : out std_ulogic;                      -- the lasers are on
    trigger         : out std_ulogic                       -- trigger of the cameras
  );
end entity;

architecture rtl of peripherals is

  signal acknowledged : std_ulogic;
  signal is_there     : std_ulogic;
  signal bitten       : std_ulogic;
  signal inner_rst    : std_ulogic;
  signal read         : std_ulogic;  -- one clock each
  signal write        : std_ulogic;
  signal address      : std_ulogic_vector(5 downto 0);
  signal uart_found   : std_ulogic_vector(31 downto 0);
  signal time_found   : std_ulogic_vector(31 downto 0);
  signal pins_found   : std_ulogic_vector(31 downto 0);
  signal state        : std_ulogic_vector(1 downto 0);  -- of the pins
  signal error_found  : std_ulogic_vector(31 downto 0);
  signal has_failed   : std_ulogic;                     -- an access of the processor has

begin

  is_there <= '1' when unsigned(adr) < PERIPHERALS_BYTES / 4 else '0';
  read     <= stb and not acknowledged and not we and is_there;
  write    <= stb and not acknowledged and we and is_there;
  address  <= adr(3 downto 0) & "00";

  ack            <= acknowledged;
  watchdog_reset <= bitten;
  inner_rst      <= rst or bitten;

  uart_i : entity work.uart
    generic map (G_CLOCKS_PER_BIT => G_CLOCKS_PER_BIT, G_LOG2_DEPTH => G_LOG2_DEPTH)
    port map (
      clk => clk, rst => inner_rst, access_read => read, write => write, address => address, write_data => dat_mosi,
      read_data => uart_found, interrupt => uart_interrupt, rx => uart_rx, tx => uart_tx);

  time_i : entity work.timer_watchdog
    generic map (G_CLOCKS_PER_US => G_CLOCKS_PER_US)
    port map (
      clk => clk, rst => rst, access_read => read, write => write, address => address, write_data => dat_mosi,
      read_data => time_found, interrupt => timer_interrupt, watchdog_reset => bitten);

  pins_found  <= (PINS_LASERS => state(PINS_LASERS), PINS_TRIGGER => state(PINS_TRIGGER), others => '0')
                 when unsigned(address) = PINS else (others => '0');
  error_found <= (BUS_ERROR_FAILED => has_failed, others => '0') when unsigned(address) = BUS_ERROR else (others => '0');
  lasers      <= state(PINS_LASERS);
  trigger     <= state(PINS_TRIGGER);

  access_p : process (clk)
  begin
    if rising_edge(clk) then
      acknowledged <= stb and not acknowledged;
      err          <= stb and not acknowledged and not is_there;
      dat_miso     <= (others => '0');
      if is_there = '1' then
        dat_miso <= uart_found or time_found or pins_found or error_found;
      end if;
      if write = '1' and unsigned(address) = PINS then
        state <= dat_mosi(1 downto 0);
      end if;
      if write = '1' and unsigned(address) = BUS_ERROR and dat_mosi(BUS_ERROR_FAILED) = '1' then
        has_failed <= '0';
      end if;
      if bus_err = '1' then
        has_failed <= '1';
      end if;
      if inner_rst = '1' then
        acknowledged <= '0';
        err          <= '0';
        state        <= (others => '0');
        has_failed   <= '0';
      end if;
    end if;
  end process;

end architecture;
