-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The processor's data bus: leads each access to where its address belongs.
--
-- Purpose     one Wishbone master to RAM, IP and peripherals
-- Rules       The processor takes no notice of errors: an access to nothing is acknowledged, reads as zero and changes nothing.
--             err tells of it, in the clock of the acknowledgement.
-- Latency     0; 1 for an access to nothing
-- Throughput  as of where the access goes
-- Resources   hw-ip/synth/resources.txt
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;

use work.soc_map_pkg.all;

entity wishbone_bus is
  port (
    clk             : in  std_ulogic;                      -- rising edge
    rst             : in  std_ulogic;                      -- synchronous, high: no access is under way

    -- The processor; address, data and the rest of a request go to all
    stb             : in  std_ulogic;                      -- a request, until it is acknowledged
    adr             : in  std_ulogic_vector(29 downto 0);  -- address of the word
    ack             : out std_ulogic;                      -- it is done
    err             : out std_ulogic;                      -- with ack: it went to nothing, or was answered by an error
    dat_miso        : out std_ulogic_vector(31 downto 0);  -- the word read

    ram_stb         : out std_ulogic;                      -- a request for the RAM
    ram_ack         : in  std_ulogic;                      -- it is done
    ram_err         : in  std_ulogic;                      -- with the acknowledgement: there is no such word
    ram_dat         : in  std_ulogic_vector(31 downto 0);  -- the word read

    karst_stb       : out std_ulogic;                      -- a request for the IP
    karst_ack       : in  std_ulogic;                      -- it is done
    karst_err       : in  std_ulogic;                      -- with the acknowledgement: it was answered by an error
    karst_dat       : in  std_ulogic_vector(31 downto 0);  -- the word read

    peripherals_stb : out std_ulogic;                      -- a request for the peripherals
    peripherals_ack : in  std_ulogic;                      -- it is done
    peripherals_err : in  std_ulogic;                      -- with the acknowledgement: there is no such register
    peripherals_dat : in  std_ulogic_vector(31 downto 0)   -- the word read
  );
end entity;

architecture rtl of wishbone_bus is

  -- The regions lie in 256 MiB each: the highest four bits of an address tell them apart
  subtype region_t is std_ulogic_vector(3 downto 0);
  constant RAM_REGION         : region_t := PROGRAM_BASE(31 downto 28);
  constant KARST_REGION       : region_t := KARST_BASE(31 downto 28);
  constant PERIPHERALS_REGION : region_t := PERIPHERALS_BASE(31 downto 28);

  signal region       : region_t;
  signal is_karst     : std_ulogic;
  signal is_nothing   : std_ulogic;
  signal acknowledged : std_ulogic;  -- an access to nothing

begin

  region <= adr(29 downto 26);

  -- Within the region of the IP its map repeats nowhere
  is_karst <= '1' when adr(29 downto 18) = KARST_BASE(31 downto 20) else '0';

  select_p : process (all)
  begin
    ram_stb         <= '0';
    karst_stb       <= '0';
    peripherals_stb <= '0';
    is_nothing      <= '0';
    ack             <= acknowledged;
    err             <= acknowledged;
    dat_miso        <= (others => '0');
    if region = RAM_REGION then
      ram_stb  <= stb;
      ack      <= ram_ack;
      err      <= ram_err;
      dat_miso <= ram_dat;
    elsif region = KARST_REGION and is_karst = '1' then
      karst_stb <= stb;
      ack       <= karst_ack;
      err       <= karst_err;
      dat_miso  <= karst_dat;
    elsif region = PERIPHERALS_REGION then
      peripherals_stb <= stb;
      ack             <= peripherals_ack;
      err             <= peripherals_err;
      dat_miso        <= peripherals_dat;
    else
      is_nothing <= stb;
    end if;
  end process;

  nothing_p : process (clk)
  begin
    if rising_edge(clk) then
      acknowledged <= is_nothing and not acknowledged;
      if rst = '1' then
        acknowledged <= '0';
      end if;
    end if;
  end process;

end architecture;
