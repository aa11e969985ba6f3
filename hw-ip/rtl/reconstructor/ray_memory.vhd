-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The rays of one camera's spots, in two banks: one is filled while the other is read.
--
-- Purpose     a ray for every bank, laser and slot; whether it exists goes with it
-- Latency     1 from the place to the ray
-- Throughput  one read and one write per clock. A ray that is written can be read from the next clock on
-- Resources   2 * 2 ** (bits of a laser's number + G_SLOT_BITS) words of 251 bits of block RAM
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity ray_memory is
  generic (
    G_LASERS    : positive range 1 to 1024;  -- most lasers
    G_SLOT_BITS : positive range 1 to 3      -- slots of a laser: 2 ** this
  );
  port (
    clk          : in  std_ulogic;                          -- rising edge
    write_valid  : in  std_ulogic;                          -- a ray is there; its laser is below G_LASERS
    write_bank   : in  std_ulogic;                          -- its place
    write_laser  : in  unsigned(9 downto 0);
    write_slot   : in  unsigned(G_SLOT_BITS - 1 downto 0);
    write_exists : in  std_ulogic;                          -- the spot has a ray
    write_ray    : in  beam_ray_t;                          -- the ray
    read_bank    : in  std_ulogic;                          -- place of the ray to read
    read_laser   : in  unsigned(9 downto 0);
    read_slot    : in  unsigned(G_SLOT_BITS - 1 downto 0);
    exists       : out std_ulogic;                          -- the spot there has a ray
    ray          : out beam_ray_t                           -- the ray
  );
end entity;

architecture rtl of ray_memory is

  constant LASER_BITS : positive := index_bits(G_LASERS);
  constant PLACE_BITS : positive := 1 + LASER_BITS + G_SLOT_BITS;

  subtype word_t   is signed(BEAM_RAY_WIDTH downto 0);
  type memory_t    is array (0 to 2 ** PLACE_BITS - 1) of word_t;
  signal memory      : memory_t;
  signal word        : word_t;
  signal write_place : unsigned(PLACE_BITS - 1 downto 0);
  signal read_place  : unsigned(PLACE_BITS - 1 downto 0);

begin

  write_place <= write_bank & write_laser(LASER_BITS - 1 downto 0) & write_slot;
  read_place  <= read_bank & read_laser(LASER_BITS - 1 downto 0) & read_slot;

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      word <= memory(to_integer(read_place));
      if write_valid = '1' then
        memory(to_integer(write_place)) <= write_exists & to_vector(write_ray);
      end if;
    end if;
  end process;

  exists <= word(BEAM_RAY_WIDTH);
  ray    <= to_beam_ray(word(BEAM_RAY_WIDTH - 1 downto 0));

end architecture;
