-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Calibration words: written one at a time, read an entry at a time.
--
-- Purpose     one memory per word of the entry
-- Latency     1 from read_entry to entry
-- Throughput  one read and one write per clock
-- Resources   G_WORDS * G_ENTRIES * 32 bits of block or distributed RAM
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity coefficient_ram is
  generic (
    G_WORDS   : positive range 1 to 32;    -- words of an entry
    G_ENTRIES : positive range 1 to 2048   -- entries
  );
  port (
    clk         : in  std_ulogic;                         -- rising edge
    write_valid : in  std_ulogic;                         -- write a word
    write_entry : in  natural range 0 to G_ENTRIES - 1;   -- of this entry
    write_word  : in  unsigned(4 downto 0);               -- at this place
    write_data  : in  signed(31 downto 0);                -- with this value
    read_entry  : in  natural range 0 to G_ENTRIES - 1;   -- entry to read
    entry       : out words_t(0 to G_WORDS - 1)           -- its words, one clock later
  );
end entity;

architecture rtl of coefficient_ram is
begin

  words_g : for i in 0 to G_WORDS - 1 generate
    signal memory : words_t(0 to G_ENTRIES - 1);
  begin

    memory_p : process (clk)
    begin
      if rising_edge(clk) then
        entry(i) <= memory(read_entry);
        if write_valid = '1' and write_word = i then
          memory(write_entry) <= write_data;
        end if;
      end if;
    end process;

  end generate;

end architecture;
