-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Records in three banks: written as a whole, read word by word.
--
-- Purpose     memory of results; which bank is written and which one is read is decided elsewhere (result_banks)
-- Latency     2 from read_record to read_data
-- Throughput  a record and a word per clock
-- Resources   one memory for each of the bytes of a word, 64 bits wide for writing and 8 for reading: block memories can
--             do that by themselves, so that no multiplexer is needed
-- Twin        karst_regs::model::Registers: the banks

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity record_memory is
  generic (
    G_RECORDS : positive range 1 to 4096 := 16  -- records of eight words in a bank
  );
  port (
    clk          : in  std_ulogic;                       -- rising edge
    write        : in  std_ulogic;                       -- stores a record
    write_bank   : in  std_ulogic_vector(1 downto 0);    -- in this bank, 0 to 2
    write_record : in  std_ulogic_vector(11 downto 0);   -- with this index, below G_RECORDS
    write_data   : in  std_ulogic_vector(255 downto 0);  -- the first word in the low bits
    read         : in  std_ulogic;                       -- reads a word; without it read_data becomes zero
    read_bank    : in  std_ulogic_vector(1 downto 0);    -- bank to read, 0 to 2
    read_record  : in  std_ulogic_vector(11 downto 0);   -- index; from G_RECORDS on it reads as zero
    read_word    : in  std_ulogic_vector(2 downto 0);    -- word of the record
    read_data    : out std_ulogic_vector(31 downto 0)    -- the word
  );
end entity;

architecture rtl of record_memory is

  constant BANKS : positive := 3;
  constant WORDS : positive := 8;

  function bits_for(count : positive) return natural is
    variable bits : natural := 0;
  begin
    while 2 ** bits < count loop
      bits := bits + 1;
    end loop;
    return bits;
  end function;

  -- Deep enough that tools make block memory of it
  constant LEAST_BITS  : positive := 6;
  constant RECORD_BITS : positive := maximum(LEAST_BITS, bits_for(G_RECORDS));

  subtype address_t is unsigned(RECORD_BITS + 1 downto 0);  -- bank and record
  signal write_address : address_t;
  signal read_address  : address_t;

  signal found    : std_ulogic_vector(31 downto 0);
  signal held     : std_ulogic_vector(31 downto 0);
  signal is_found : std_ulogic_vector(1 to 2);  -- 1 and 2 clocks after read

begin

  write_address <= unsigned(write_bank & write_record(RECORD_BITS - 1 downto 0));
  read_address  <= unsigned(read_bank & read_record(RECORD_BITS - 1 downto 0));

  bytes_g : for byte in 0 to 3 generate
    subtype byte_t is std_ulogic_vector(7 downto 0);
    type memory_t is array (0 to BANKS * WORDS * 2 ** RECORD_BITS - 1) of byte_t;
    signal memory : memory_t := (others => (others => '0'));
  begin

    memory_p : process (clk)
      variable low : natural range 0 to 255;
    begin
      if rising_edge(clk) then
        if write = '1' then
          for word in 0 to WORDS - 1 loop
            low := 32 * word + 8 * byte;
            memory(to_integer(write_address & to_unsigned(word, 3))) <= write_data(low + 7 downto low);
          end loop;
        end if;
        found(8 * byte + 7 downto 8 * byte) <= memory(to_integer(read_address & unsigned(read_word)));
      end if;
    end process;

  end generate;

  read_p : process (clk)
  begin
    if rising_edge(clk) then
      held        <= found;
      is_found(1) <= '1' when read = '1' and unsigned(read_record) < G_RECORDS else '0';
      is_found(2) <= is_found(1);
    end if;
  end process;

  read_data <= held and is_found(2);

end architecture;
