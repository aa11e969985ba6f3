-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The settings as software writes them.
--
-- Purpose     words with two ports: the bus reads and writes, settings_load reads
-- Latency     2 from bus_read to bus_found, 1 from load_address to load_data
-- Throughput  an access per clock and port
-- Resources   G_WORDS words of memory: four RAMB18 for 12 lasers
-- Twin        karst_regs::model::Registers: the settings

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity settings_memory is
  generic (
    G_WORDS : positive range 1 to 65536 := 1024  -- words of 32 bits
  );
  port (
    clk          : in  std_ulogic;                      -- rising edge
    bus_read     : in  std_ulogic;                      -- reads a word; without it bus_found becomes zero
    bus_write    : in  std_ulogic;                      -- stores the bytes of bus_strobe
    bus_address  : in  std_ulogic_vector(15 downto 0);  -- of a word; from G_WORDS on it is not stored and reads as zero
    bus_strobe   : in  std_ulogic_vector(3 downto 0);   -- bytes to be written
    bus_data     : in  std_ulogic_vector(31 downto 0);  -- to be written
    bus_found    : out std_ulogic_vector(31 downto 0);  -- the word
    load_address : in  std_ulogic_vector(15 downto 0);  -- of a word, below G_WORDS
    load_data    : out std_ulogic_vector(31 downto 0)   -- the word
  );
end entity;

architecture rtl of settings_memory is

  signal exists   : std_ulogic;
  signal found    : std_ulogic_vector(31 downto 0);
  signal held     : std_ulogic_vector(31 downto 0);
  signal is_found : std_ulogic_vector(1 to 2);  -- 1 and 2 clocks after bus_read

begin

  exists <= '1' when unsigned(bus_address) < G_WORDS else '0';

  read_p : process (clk)
  begin
    if rising_edge(clk) then
      held     <= found;
      is_found <= (exists and bus_read) & is_found(1);
    end if;
  end process;

  bus_found <= held and is_found(2);

  -- One memory per byte: any tool makes byte strobes of that
  bytes_g : for byte in 0 to 3 generate
    subtype byte_t is std_ulogic_vector(7 downto 0);
    type memory_t is array (0 to G_WORDS - 1) of byte_t;
    signal memory : memory_t := (others => (others => '0'));
  begin

    memory_p : process (clk)
    begin
      if rising_edge(clk) then
        if exists = '1' then
          if bus_write = '1' and bus_strobe(byte) = '1' then
            memory(to_integer(unsigned(bus_address))) <= bus_data(8 * byte + 7 downto 8 * byte);
          end if;
          found(8 * byte + 7 downto 8 * byte) <= memory(to_integer(unsigned(bus_address)));
        end if;
        load_data(8 * byte + 7 downto 8 * byte) <= memory(to_integer(unsigned(load_address)));
      end if;
    end process;

  end generate;

end architecture;
