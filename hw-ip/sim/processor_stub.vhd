-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- In place of the processor: its pins are signals that a bench drives and reads.
--
-- Purpose     lets tb_soc make the accesses that a program would make
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;

package processor_stub_pkg is

  -- Driven by the bench
  signal stub_i_stb      : std_ulogic := '0';
  signal stub_i_adr      : std_ulogic_vector(29 downto 0) := (others => '0');
  signal stub_i_cti      : std_ulogic_vector(2 downto 0) := (others => '0');
  signal stub_d_stb      : std_ulogic := '0';
  signal stub_d_we       : std_ulogic := '0';
  signal stub_d_adr      : std_ulogic_vector(29 downto 0) := (others => '0');
  signal stub_d_sel      : std_ulogic_vector(3 downto 0) := (others => '0');
  signal stub_d_cti      : std_ulogic_vector(2 downto 0) := (others => '0');
  signal stub_d_dat_mosi : std_ulogic_vector(31 downto 0) := (others => '0');

  -- Driven by the SoC
  signal stub_reset      : std_ulogic;
  signal stub_timer      : std_ulogic;
  signal stub_interrupts : std_ulogic_vector(31 downto 0);
  signal stub_start      : std_ulogic_vector(31 downto 0);
  signal stub_i_ack      : std_ulogic;
  signal stub_i_dat_miso : std_ulogic_vector(31 downto 0);
  signal stub_d_ack      : std_ulogic;
  signal stub_d_dat_miso : std_ulogic_vector(31 downto 0);

end package;

library ieee;
use ieee.std_logic_1164.all;

use work.processor_stub_pkg.all;

entity \VexRiscv\ is
  port (
    \clk\                    : in  std_ulogic;                      -- as of the processor
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
end entity;

architecture sim of \VexRiscv\ is
begin

  stub_reset      <= \reset\;
  stub_timer      <= \timerInterrupt\;
  stub_interrupts <= \externalInterruptArray\;
  stub_start      <= \externalResetVector\;
  stub_i_ack      <= \iBusWishbone_ACK\;
  stub_i_dat_miso <= \iBusWishbone_DAT_MISO\;
  stub_d_ack      <= \dBusWishbone_ACK\;
  stub_d_dat_miso <= \dBusWishbone_DAT_MISO\;

  \iBusWishbone_CYC\      <= stub_i_stb;
  \iBusWishbone_STB\      <= stub_i_stb;
  \iBusWishbone_WE\       <= '0';
  \iBusWishbone_ADR\      <= stub_i_adr;
  \iBusWishbone_DAT_MOSI\ <= (others => '0');
  \iBusWishbone_SEL\      <= (others => '1');
  \iBusWishbone_CTI\      <= stub_i_cti;
  \iBusWishbone_BTE\      <= (others => '0');
  \dBusWishbone_CYC\      <= stub_d_stb;
  \dBusWishbone_STB\      <= stub_d_stb;
  \dBusWishbone_WE\       <= stub_d_we;
  \dBusWishbone_ADR\      <= stub_d_adr;
  \dBusWishbone_DAT_MOSI\ <= stub_d_dat_mosi;
  \dBusWishbone_SEL\      <= stub_d_sel;
  \dBusWishbone_CTI\      <= stub_d_cti;
  \dBusWishbone_BTE\      <= (others => '0');

end architecture;
