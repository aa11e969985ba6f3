-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Records in two banks: written as a whole, read word by word.
--
-- Purpose     memory of results; which bank is written and which one is read is decided elsewhere (result_banks)
-- Latency     2 from read_record to read_data
-- Throughput  a record and a word per clock
-- Resources   2 ** (1 + ceil(log2 G_RECORDS)), at least 64, words of 32 * G_WORDS bits of memory; a multiplexer of
--             G_WORDS to 1
-- Twin        karst_regs::model::Registers: the banks

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity record_memory is
  generic (
    G_RECORDS : positive range 1 to 4096 := 16;  -- records in a bank
    G_WORDS   : positive range 2 to 16 := 8      -- words of 32 bits in a record, a power of two
  );
  port (
    clk          : in  std_ulogic;                                    -- rising edge
    write        : in  std_ulogic;                                    -- stores a record
    write_bank   : in  std_ulogic;                                    -- in this bank
    write_record : in  std_ulogic_vector(11 downto 0);                -- with this index, below G_RECORDS
    write_data   : in  std_ulogic_vector(32 * G_WORDS - 1 downto 0);  -- the first word in the low bits
    read_bank    : in  std_ulogic;                                    -- bank to read
    read_record  : in  std_ulogic_vector(11 downto 0);                -- index; from G_RECORDS on it reads as zero
    read_word    : in  std_ulogic_vector(3 downto 0);                 -- word of the record, below G_WORDS
    read_data    : out std_ulogic_vector(31 downto 0)                 -- the word
  );
end entity;

architecture rtl of record_memory is

  function bits_for(count : positive) return natural is
    variable bits : natural := 0;
  begin
    while 2 ** bits < count loop
      bits := bits + 1;
    end loop;
    return bits;
  end function;

  -- Deep enough that tools make block memory of it: a few wide records would cost many LUT and FF
  constant LEAST_BITS  : natural := 5;
  constant RECORD_BITS : natural := maximum(LEAST_BITS, bits_for(G_RECORDS));

  subtype record_t is std_ulogic_vector(32 * G_WORDS - 1 downto 0);
  type memory_t is array (0 to 2 ** (RECORD_BITS + 1) - 1) of record_t;
  signal memory : memory_t := (others => (others => '0'));

  signal found        : record_t;
  signal found_word   : natural range 0 to G_WORDS - 1;
  signal found_exists : std_ulogic;

begin

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      if write = '1' then
        memory(to_integer(unsigned(write_bank & write_record(RECORD_BITS - 1 downto 0)))) <= write_data;
      end if;
      found        <= memory(to_integer(unsigned(read_bank & read_record(RECORD_BITS - 1 downto 0))));
      found_word   <= to_integer(unsigned(read_word)) mod G_WORDS;
      found_exists <= '1' when unsigned(read_record) < G_RECORDS else '0';
    end if;
  end process;

  word_p : process (clk)
    variable word : std_ulogic_vector(31 downto 0);
  begin
    if rising_edge(clk) then
      word := (others => '0');
      for i in 0 to G_WORDS - 1 loop
        if i = found_word and found_exists = '1' then
          word := found(32 * i + 31 downto 32 * i);
        end if;
      end loop;
      read_data <= word;
    end if;
  end process;

end architecture;
