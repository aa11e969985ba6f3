-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Which slots of a laser hold a spot of one camera, and in which one the farthest is; in two banks.
--
-- Purpose     keeps the masks of the lasers and, for the paper's method, of every laser the slot of the spot with the
--             largest radius, of equal ones the last slot
-- Latency     1 from the laser to its slots. The slots can be read from the clock after mask_valid on, the farthest of
--             them from 2 + G_SLOT_BITS clocks after it on: settling tells
-- Throughput  one spot, one mask and one read per clock
-- Resources   2 * 2 ** (bits of a laser's number) words of 17 * 2 ** G_SLOT_BITS + G_SLOT_BITS bits of RAM
-- Twin        karst_core's reconstruct.rs: the slices of spots, Candidates::paper

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity candidates is
  generic (
    G_LASERS    : positive range 1 to 1024;  -- most lasers
    G_SLOT_BITS : positive range 1 to 3      -- slots of a laser: 2 ** this
  );
  port (
    clk         : in  std_ulogic;                                        -- rising edge
    rst         : in  std_ulogic;                                        -- synchronous, high: forgets what is under way
    spot_valid  : in  std_ulogic;                                        -- a spot is there
    spot_bank   : in  std_ulogic;                                        -- its place; the laser is below G_LASERS
    spot_laser  : in  unsigned(9 downto 0);
    spot_slot   : in  unsigned(G_SLOT_BITS - 1 downto 0);
    spot_radius : in  unsigned(15 downto 0);                             -- greatest distance from the centre, 1/16 px
    mask_valid  : in  std_ulogic;                                        -- a mask is there, after the spots
    mask_bank   : in  std_ulogic;                                        -- its place; the laser is below G_LASERS
    mask_laser  : in  unsigned(9 downto 0);
    mask_slots  : in  std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);  -- slots that hold a spot
    read_bank   : in  std_ulogic;                                        -- place of the mask to read
    read_laser  : in  unsigned(9 downto 0);
    slots       : out std_ulogic_vector(2 ** G_SLOT_BITS - 1 downto 0);  -- slots that hold a spot
    farthest    : out unsigned(G_SLOT_BITS - 1 downto 0);                -- one of them, if there is any
    settling    : out std_ulogic_vector(1 downto 0)                      -- a farthest one of this bank is not there yet
  );
end entity;

architecture rtl of candidates is

  constant LASER_BITS : positive := index_bits(G_LASERS);
  constant SLOTS_HERE : positive := 2 ** G_SLOT_BITS;

  subtype place_t   is unsigned(LASER_BITS downto 0);
  subtype slot_t    is unsigned(G_SLOT_BITS - 1 downto 0);
  subtype radius_t  is unsigned(15 downto 0);
  subtype mask_t    is std_ulogic_vector(SLOTS_HERE - 1 downto 0);
  type radii_t      is array (0 to SLOTS_HERE - 1) of radius_t;
  type radii_memory_t    is array (0 to 2 ** (LASER_BITS + 1) - 1) of radius_t;
  type masks_memory_t    is array (0 to 2 ** (LASER_BITS + 1) - 1) of mask_t;
  type farthest_memory_t is array (0 to 2 ** (LASER_BITS + 1) - 1) of slot_t;

  -- Clocks from a mask to its farthest slot: one to its radii, and one for each round
  constant FOUND : positive := 1 + G_SLOT_BITS;
  type places_t is array (1 to FOUND + 1) of place_t;

  -- The farther of some slots
  type choice_t is record
    any    : std_ulogic;
    slot   : slot_t;
    radius : radius_t;
  end record;
  type choices_t is array (0 to SLOTS_HERE - 1) of choice_t;
  type rounds_t is array (0 to G_SLOT_BITS) of choices_t;

  signal rounds        : rounds_t;  -- each with half as many choices as the one before
  signal masks         : masks_memory_t;
  signal farthest_ones : farthest_memory_t;
  signal radii         : radii_t;  -- of the last mask
  signal spot_place    : place_t;
  signal mask_place    : place_t;
  signal read_place    : place_t;
  signal slots_at      : mask_t;
  signal place_at      : places_t;                        -- of the last masks
  signal valid_at      : std_ulogic_vector(1 to FOUND + 1);

begin

  spot_place <= spot_bank & spot_laser(LASER_BITS - 1 downto 0);
  mask_place <= mask_bank & mask_laser(LASER_BITS - 1 downto 0);
  read_place <= read_bank & read_laser(LASER_BITS - 1 downto 0);

  radii_g : for i in 0 to SLOTS_HERE - 1 generate
    signal memory : radii_memory_t;
  begin

    radius_p : process (clk)
    begin
      if rising_edge(clk) then
        radii(i) <= memory(to_integer(mask_place));
        if spot_valid = '1' and spot_slot = i then
          memory(to_integer(spot_place)) <= spot_radius;
        end if;
      end if;
    end process;

  end generate;

  slots_g : for i in 0 to SLOTS_HERE - 1 generate
    rounds(0)(i) <= (any => slots_at(i), slot => to_unsigned(i, G_SLOT_BITS), radius => radii(i));
  end generate;

  rounds_g : for round in 1 to G_SLOT_BITS generate
    choices_g : for i in 0 to 2 ** (G_SLOT_BITS - round) - 1 generate

      choose_p : process (clk)
      begin
        if rising_edge(clk) then
          rounds(round)(i) <= rounds(round - 1)(2 * i);
          if rounds(round - 1)(2 * i + 1).any = '1' and (rounds(round - 1)(2 * i).any = '0' or
            rounds(round - 1)(2 * i + 1).radius >= rounds(round - 1)(2 * i).radius) then
            rounds(round)(i) <= rounds(round - 1)(2 * i + 1);
          end if;
        end if;
      end process;

    end generate;
  end generate;

  masks_p : process (clk)
  begin
    if rising_edge(clk) then
      slots <= masks(to_integer(read_place));
      if mask_valid = '1' then
        masks(to_integer(mask_place)) <= mask_slots;
      end if;
      farthest <= farthest_ones(to_integer(read_place));
      if valid_at(FOUND) = '1' then
        farthest_ones(to_integer(place_at(FOUND))) <= rounds(G_SLOT_BITS)(0).slot;
      end if;

      slots_at <= mask_slots;
      place_at <= mask_place & place_at(1 to FOUND);
      valid_at <= mask_valid & valid_at(1 to FOUND);
      if rst = '1' then
        valid_at <= (others => '0');
      end if;
    end if;
  end process;

  settling_p : process (all)
  begin
    settling <= "00";
    for i in valid_at'range loop
      if valid_at(i) = '1' and place_at(i)(LASER_BITS) = '0' then
        settling(0) <= '1';
      elsif valid_at(i) = '1' then
        settling(1) <= '1';
      end if;
    end loop;
  end process;

end architecture;
