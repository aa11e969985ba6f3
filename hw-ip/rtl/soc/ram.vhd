-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- On-chip RAM of the processor.
--
-- Purpose     memory of program and data, with a port for each of the processor's buses, so that they never wait for each other
-- Rules       An address outside reads as zero and is not written. Bursts (CTI 010) have consecutive addresses.
-- Latency     1 from a request to its acknowledgement; in a burst every further word comes with the next clock
-- Throughput  one word per 2 clocks; in a burst one per clock; each port
-- Resources   one RAMB36 per 4 KiB
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use std.textio.all;

entity ram is
  generic (
    G_BASE  : std_ulogic_vector(31 downto 0) := x"80000000";  -- address of the first byte
    G_WORDS : positive range 1 to 65536 := 12288;             -- size
    G_IMAGE : string := ""                                    -- file with the first words, in hexadecimal, one a line; none: zeros
  );
  port (
    clk          : in  std_ulogic;                      -- rising edge
    rst          : in  std_ulogic;                      -- synchronous, high: no access is under way. The memory stays

    -- Wishbone, instructions: as of the processor
    i_stb        : in  std_ulogic;                      -- a request, until it is acknowledged
    i_adr        : in  std_ulogic_vector(29 downto 0);  -- address of the word
    i_cti        : in  std_ulogic_vector(2 downto 0);   -- 010: the next address will be wanted next
    i_ack        : out std_ulogic;                      -- the word is there
    i_dat_miso   : out std_ulogic_vector(31 downto 0);  -- the word

    -- Wishbone, data
    d_stb        : in  std_ulogic;                      -- a request, until it is acknowledged
    d_we         : in  std_ulogic;                      -- it is a write
    d_adr        : in  std_ulogic_vector(29 downto 0);  -- address of the word
    d_sel        : in  std_ulogic_vector(3 downto 0);   -- bytes to be written
    d_cti        : in  std_ulogic_vector(2 downto 0);   -- 010: the next address will be wanted next
    d_dat_mosi   : in  std_ulogic_vector(31 downto 0);  -- the word to be written
    d_ack        : out std_ulogic;                      -- the word is there, or is written
    d_err        : out std_ulogic;                      -- with d_ack: the address is outside
    d_dat_miso   : out std_ulogic_vector(31 downto 0);  -- the word

    -- Loading the program from outside, while rst is high
    load_write   : in  std_ulogic;                      -- writes a word
    load_address : in  std_ulogic_vector(15 downto 0);  -- its place, in words from the start of the RAM
    load_data    : in  std_ulogic_vector(31 downto 0)   -- the word
  );
end entity;

architecture rtl of ram is

  constant BURST : std_ulogic_vector(2 downto 0) := "010";
  constant FIRST : unsigned(29 downto 0) := unsigned(G_BASE(31 downto 2));

  subtype address_t is unsigned(29 downto 0);
  subtype place_t is natural range 0 to G_WORDS - 1;
  subtype byte_t is std_ulogic_vector(7 downto 0);
  type memory_t is array (place_t) of byte_t;

  signal i_acknowledged : std_ulogic;
  signal d_acknowledged : std_ulogic;
  signal i_next         : address_t;
  signal d_next         : address_t;
  signal i_exists       : std_ulogic;
  signal d_exists       : std_ulogic;
  signal i_found        : std_ulogic_vector(31 downto 0);
  signal d_found        : std_ulogic_vector(31 downto 0);
  signal i_was_there    : std_ulogic;
  signal d_was_there    : std_ulogic;
  signal i_place        : place_t;
  signal d_place        : place_t;
  signal write          : std_ulogic_vector(3 downto 0);
  signal written        : std_ulogic_vector(31 downto 0);

  -- One byte of each word of the image
  impure function image(byte : natural range 0 to 3) return memory_t is
    file source     : text;
    variable row    : line;
    variable word   : std_ulogic_vector(31 downto 0);
    variable result : memory_t := (others => (others => '0'));
  begin
    if G_IMAGE /= "" then
      file_open(source, G_IMAGE, read_mode);
      for place in place_t loop
        if not endfile(source) then
          readline(source, row);
          hread(row, word);
          result(place) := word(8 * byte + 7 downto 8 * byte);
        end if;
      end loop;
      file_close(source);
    end if;
    return result;
  end function;

  function exists(address : address_t) return std_ulogic is
  begin
    if address - FIRST < G_WORDS then
      return '1';
    end if;
    return '0';
  end function;

  -- Where a word is; anywhere if it does not exist
  function place_of(address : address_t) return place_t is
  begin
    if exists(address) = '1' then
      return to_integer(address - FIRST);
    end if;
    return 0;
  end function;

begin

  -- In a burst the next word is looked up while this one is acknowledged
  i_next <= unsigned(i_adr) + 1 when i_acknowledged = '1' else unsigned(i_adr);
  d_next <= FIRST + unsigned(load_address) when rst = '1' else
            unsigned(d_adr) + 1 when d_acknowledged = '1' else
            unsigned(d_adr);

  i_exists <= exists(i_next);
  d_exists <= exists(d_next);
  i_place  <= place_of(i_next);
  d_place  <= place_of(d_next);

  write_p : process (all)
  begin
    written <= d_dat_mosi;
    write   <= (others => '0');
    if rst = '1' then
      written <= load_data;
      write   <= (others => load_write and d_exists);
    elsif d_stb = '1' and d_we = '1' and d_acknowledged = '0' and d_exists = '1' then
      write <= d_sel;
    end if;
  end process;

  -- One memory per byte: any tool makes byte strobes of that
  bytes_g : for byte in 0 to 3 generate
    signal memory : memory_t := image(byte);
  begin

    memory_p : process (clk)
    begin
      if rising_edge(clk) then
        if write(byte) = '1' then
          memory(d_place) <= written(8 * byte + 7 downto 8 * byte);
        end if;
        d_found(8 * byte + 7 downto 8 * byte) <= memory(d_place);
        i_found(8 * byte + 7 downto 8 * byte) <= memory(i_place);
      end if;
    end process;

  end generate;

  answer_p : process (clk)
  begin
    if rising_edge(clk) then
      i_was_there    <= i_exists;
      d_was_there    <= d_exists;
      i_acknowledged <= '0';
      if i_stb = '1' and (i_acknowledged = '0' or i_cti = BURST) then
        i_acknowledged <= '1';
      end if;
      d_acknowledged <= '0';
      if d_stb = '1' and (d_acknowledged = '0' or (d_cti = BURST and d_we = '0')) then
        d_acknowledged <= '1';
      end if;
      if rst = '1' then
        i_acknowledged <= '0';
        d_acknowledged <= '0';
      end if;
    end if;
  end process;

  i_ack      <= i_acknowledged;
  d_ack      <= d_acknowledged;
  d_err      <= d_acknowledged and not d_was_there;
  i_dat_miso <= i_found when i_was_there = '1' else (others => '0');
  d_dat_miso <= d_found when d_was_there = '1' else (others => '0');

end architecture;
