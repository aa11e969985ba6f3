-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The settings of the reconstructor.
--
-- Purpose     picks the reconstructor's words out of the settings as they are streamed: holds method and limits, and passes
--             the calibration on to its memories
-- Latency     1
-- Throughput  a word per clock
-- Resources   about 160 FF and 40 LUT
-- Twin        karst_regs::Settings: the words of Calibration

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.karst_map_pkg.all;

entity reconstructor_settings is
  port (
    clk           : in  std_ulogic;                      -- rising edge
    load_valid    : in  std_ulogic;                      -- a word, while no frame is under way
    load_address  : in  std_ulogic_vector(15 downto 0);  -- its address in words
    load_data     : in  std_ulogic_vector(31 downto 0);  -- the word
    lasers        : out std_ulogic_vector(10 downto 0);  -- how many there are
    paper         : out std_ulogic;                      -- the rest as reconstructor with 8 terms
    single_camera : out std_ulogic;
    range_min     : out std_ulogic_vector(31 downto 0);
    range_max     : out std_ulogic_vector(31 downto 0);
    chi2_max      : out std_ulogic_vector(31 downto 0);
    write_valid   : out std_ulogic;
    write_table   : out std_ulogic_vector(1 downto 0);
    write_entry   : out std_ulogic_vector(10 downto 0);
    write_word    : out std_ulogic_vector(4 downto 0);
    write_data    : out std_ulogic_vector(31 downto 0)
  );
end entity;

architecture rtl of reconstructor_settings is

  -- Word of the settings memory at a byte address
  function word(address : natural) return natural is
  begin
    return (address - SETTINGS_INSTRUMENT_LASERS) / 4;
  end function;

  constant METHOD         : natural := word(SETTINGS_INSTRUMENT_LASERS);
  constant LEAST_RANGE    : natural := word(SETTINGS_INSTRUMENT_RANGE_MIN);
  constant GREATEST_RANGE : natural := word(SETTINGS_INSTRUMENT_RANGE_MAX);
  constant LARGEST_CHI2   : natural := word(SETTINGS_INSTRUMENT_CHI2_MAX);

  -- Cameras and lasers have blocks of words; where things are in them
  constant BLOCK_WORDS   : positive := SETTINGS_CAMERA_STRIDE / 4;
  constant FIRST_CAMERA  : natural := word(SETTINGS_CAMERA_DETECTOR_SIZE) / BLOCK_WORDS;
  constant FIRST_LASER   : natural := word(SETTINGS_LASER_AZIMUTH) / BLOCK_WORDS;
  constant CAMERA_WORD   : natural := word(SETTINGS_CAMERA_CENTRE) mod BLOCK_WORDS;
  constant CAMERA_WORDS  : positive := (SETTINGS_CAMERA_AXIAL - SETTINGS_CAMERA_CENTRE) / 4 + 8;
  constant PLACE_WORD    : natural := word(SETTINGS_LASER_ORIGIN) mod BLOCK_WORDS;
  constant VARIANCE_WORD : natural := word(SETTINGS_LASER_ORIGIN_VARIANCE) mod BLOCK_WORDS;
  constant FRAME_WORD    : natural := word(SETTINGS_LASER_CAMERA_ROTATION) mod BLOCK_WORDS;
  constant FRAME_WORDS   : positive := SETTINGS_LASER_CAMERA_STRIDE / 4;

  subtype table_t is std_ulogic_vector(1 downto 0);
  constant CAMERAS       : table_t := "00";
  constant FRAMES        : table_t := "01";
  constant PLACES        : table_t := "10";
  constant UNCERTAINTIES : table_t := "11";

begin

  assert SETTINGS_LASER_STRIDE = SETTINGS_CAMERA_STRIDE and BLOCK_WORDS = 64
    report "cameras and lasers have blocks of another size" severity failure;

  settings_p : process (clk)
    variable at          : natural range 0 to 65535;
    variable block_index : natural range 0 to 1023;
    variable place       : natural range 0 to 63;
    variable laser       : unsigned(9 downto 0);

    procedure pass(table : table_t; entry : unsigned; first : natural) is
    begin
      write_valid <= '1';
      write_table <= table;
      write_entry <= std_ulogic_vector(resize(entry, 11));
      write_word  <= std_ulogic_vector(to_unsigned(place - first, 5));
    end procedure;
  begin
    if rising_edge(clk) then
      write_valid <= '0';
      write_data  <= load_data;
      at          := to_integer(unsigned(load_address));
      block_index := at / BLOCK_WORDS;
      place       := at mod BLOCK_WORDS;
      laser       := to_unsigned(block_index, 10) - FIRST_LASER;
      if load_valid = '1' then
        if at = METHOD then
          lasers        <= load_data(SETTINGS_INSTRUMENT_LASERS_COUNT);
          paper         <= load_data(SETTINGS_INSTRUMENT_LASERS_PAPER);
          single_camera <= load_data(SETTINGS_INSTRUMENT_LASERS_SINGLE_CAMERA);
        elsif at = LEAST_RANGE then
          range_min <= load_data;
        elsif at = GREATEST_RANGE then
          range_max <= load_data;
        elsif at = LARGEST_CHI2 then
          chi2_max <= load_data;
        elsif block_index >= FIRST_LASER then
          if place >= FRAME_WORD + 2 * FRAME_WORDS then
            null;
          elsif place >= FRAME_WORD + FRAME_WORDS then
            pass(FRAMES, laser & '1', FRAME_WORD + FRAME_WORDS);
          elsif place >= FRAME_WORD then
            pass(FRAMES, laser & '0', FRAME_WORD);
          elsif place >= VARIANCE_WORD then
            pass(UNCERTAINTIES, laser, VARIANCE_WORD);
          elsif place >= PLACE_WORD then
            pass(PLACES, laser, PLACE_WORD);
          end if;
        elsif block_index >= FIRST_CAMERA and block_index < FIRST_CAMERA + 2 and place >= CAMERA_WORD and
              place < CAMERA_WORD + CAMERA_WORDS then
          pass(CAMERAS, to_unsigned(block_index - FIRST_CAMERA, 10), CAMERA_WORD);
        end if;
      end if;
    end if;
  end process;

end architecture;
