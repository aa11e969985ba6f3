-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Rays of a laser's candidate spots to the pairs that are tried, one per clock.
--
-- Purpose     keeps the rays of one laser while those of the next arrive. Weighted: every pair of the two cameras' rays,
--             camera 2 fastest, then, if a camera alone may do, every ray of camera 1 and of camera 2. Paper: the farthest
--             spots' pair, then each of the two. A laser without any pair gets one that does not take part
-- Latency     2 from a laser's last ray to its first pair
-- Throughput  one pair per clock. The last rays of two lasers must be apart by the number of the first one's pairs:
--             reconstructor sees to that
-- Resources   4 * G_CANDIDATES rays of 251 bits of distributed RAM
-- Twin        karst_core's reconstruct.rs: Candidates

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity pairing is
  generic (
    G_CANDIDATES : positive range 1 to 7  -- most spots of a laser in a camera
  );
  port (
    clk           : in  std_ulogic;             -- rising edge
    rst           : in  std_ulogic;             -- synchronous, high: forgets what is under way
    paper         : in  std_ulogic;             -- the paper's method instead of the weighted one, constant
    single_camera : in  std_ulogic;             -- one camera alone may give a point, constant
    in_valid      : in  std_ulogic;             -- a ray is there, or a laser's end without a ray
    in_present    : in  std_ulogic;             -- there is a spot
    in_camera     : in  std_ulogic;             -- its camera: 0 for camera 1
    in_last       : in  std_ulogic;             -- the last of its laser
    in_laser      : in  unsigned(9 downto 0);   -- the laser
    in_radius     : in  unsigned(15 downto 0);  -- greatest distance from the image centre, 1/16 px
    in_exists     : in  std_ulogic;             -- the spot's ray exists
    in_ray        : in  beam_ray_t;             -- the ray
    out_valid     : out std_ulogic;             -- a pair is there
    out_first     : out std_ulogic;             -- the first of its laser
    out_last      : out std_ulogic;             -- the last of its laser
    out_takes_part : out std_ulogic;            -- the rays exist
    out_single    : out std_ulogic;             -- the second ray is the beam
    out_laser     : out unsigned(9 downto 0);   -- the laser
    out_reason    : out outcome_t;              -- why the laser has no point if no pair gives one
    out_used      : out unsigned(1 downto 0);   -- spots in the pair: camera 1 (bit 0), camera 2 (bit 1)
    out_spot_1    : out unsigned(2 downto 0);   -- which of camera 1's spots
    out_spot_2    : out unsigned(2 downto 0);   -- which of camera 2's spots
    out_ray_a     : out beam_ray_t;             -- first ray
    out_ray_b     : out beam_ray_t              -- second ray; all zero if it is the beam
  );
end entity;

architecture rtl of pairing is

  subtype place_t is unsigned(2 downto 0);
  subtype count_t is unsigned(3 downto 0);
  type counts_t   is array (0 to 1) of count_t;
  type places_t   is array (0 to 1) of place_t;
  type radii_t    is array (0 to 1) of unsigned(15 downto 0);
  -- A ray and whether it exists
  type rays_t     is array (0 to 2 * G_CANDIDATES - 1) of signed(BEAM_RAY_WIDTH downto 0);
  type phase_t    is (IDLE, PAIRS, FIRST_ALONE, SECOND_ALONE, NOTHING);

  -- The laser that arrives; two banks take turns
  signal rays_1, rays_2 : rays_t;
  signal bank           : std_ulogic;
  signal arrived        : counts_t;
  signal farthest       : places_t;
  signal radius         : radii_t;

  -- The laser that is paired
  signal phase        : phase_t;
  signal is_first     : std_ulogic;
  signal pairing_bank : std_ulogic;
  signal pairing_laser : unsigned(9 downto 0);
  signal counts       : counts_t;  -- spots to go through
  signal has          : unsigned(1 downto 0);  -- the cameras have spots
  signal base         : places_t;  -- the first of them
  signal first_place  : place_t;   -- from the base
  signal second_place : place_t;   -- from the base

  function address(of_bank : std_ulogic; place : place_t) return natural is
  begin
    if of_bank = '1' then
      return G_CANDIDATES + to_integer(place);
    end if;
    return to_integer(place);
  end function;

  -- Rays out of the memories, the existence in the high bit
  signal ray_1, ray_2 : signed(BEAM_RAY_WIDTH downto 0);

begin

  ray_1 <= rays_1(address(pairing_bank, base(0) + first_place));
  ray_2 <= rays_2(address(pairing_bank, base(1) + second_place));

  pair_p : process (clk)
    variable next_arrived : counts_t;
    variable next_farthest : places_t;
    variable ray          : signed(BEAM_RAY_WIDTH downto 0);
    variable alone        : boolean;
    variable ends         : boolean;
  begin
    if rising_edge(clk) then

      -- The pair of this clock
      out_valid  <= '0' when phase = IDLE else '1';
      out_first  <= is_first;
      out_single <= '0' when phase = PAIRS else '1';
      out_laser  <= pairing_laser;
      out_spot_1 <= base(0) + first_place;
      out_spot_2 <= base(1) + second_place;
      out_ray_a  <= to_beam_ray(ray_1(BEAM_RAY_WIDTH - 1 downto 0));
      out_ray_b  <= to_beam_ray(to_signed(0, BEAM_RAY_WIDTH));
      if phase = PAIRS then
        out_ray_b      <= to_beam_ray(ray_2(BEAM_RAY_WIDTH - 1 downto 0));
        out_takes_part <= ray_1(BEAM_RAY_WIDTH) and ray_2(BEAM_RAY_WIDTH) and has(0) and has(1);
        out_used       <= "11";
      elsif phase = FIRST_ALONE then
        out_takes_part <= ray_1(BEAM_RAY_WIDTH) and has(0);
        out_used       <= "01";
      elsif phase = SECOND_ALONE then
        out_ray_a      <= to_beam_ray(ray_2(BEAM_RAY_WIDTH - 1 downto 0));
        out_takes_part <= ray_2(BEAM_RAY_WIDTH) and has(1);
        out_used       <= "10";
      else
        out_takes_part <= '0';
        out_used       <= "00";
      end if;
      if paper = '1' then
        out_used <= has;
      end if;
      if has = "00" then
        out_reason <= NO_SPOT;
      elsif has = "11" or paper = '1' then
        out_reason <= NO_INTERSECTION;
      else
        out_reason <= ONE_CAMERA;
      end if;

      -- The pair after it
      alone    := paper = '1' or single_camera = '1';
      ends     := false;
      is_first <= '0';
      if phase = PAIRS then
        if second_place + 1 < counts(1) then
          second_place <= second_place + 1;
        elsif first_place + 1 < counts(0) then
          first_place  <= first_place + 1;
          second_place <= (others => '0');
        elsif alone then
          phase        <= FIRST_ALONE;
          first_place  <= (others => '0');
          second_place <= (others => '0');
        else
          ends := true;
        end if;
      elsif phase = FIRST_ALONE then
        if first_place + 1 < counts(0) then
          first_place <= first_place + 1;
        elsif counts(1) /= 0 then
          phase       <= SECOND_ALONE;
          first_place <= (others => '0');
        else
          ends := true;
        end if;
      elsif phase = SECOND_ALONE then
        if second_place + 1 < counts(1) then
          second_place <= second_place + 1;
        else
          ends := true;
        end if;
      else
        ends := true;
      end if;
      out_last <= '1' when ends else '0';
      if ends then
        phase <= IDLE;
      end if;

      -- The ray that arrives
      ray           := in_exists & to_vector(in_ray);
      next_arrived  := arrived;
      next_farthest := farthest;
      if in_valid = '1' and in_present = '1' then
        if in_camera = '0' then
          rays_1(address(bank, arrived(0)(2 downto 0))) <= ray;
        else
          rays_2(address(bank, arrived(1)(2 downto 0))) <= ray;
        end if;
        for camera in 0 to 1 loop
          if (in_camera = '1') = (camera = 1) then
            next_arrived(camera) := arrived(camera) + 1;
            -- Of equally far spots the last one
            if arrived(camera) = 0 or in_radius >= radius(camera) then
              next_farthest(camera) := arrived(camera)(2 downto 0);
              radius(camera)        <= in_radius;
            end if;
          end if;
        end loop;
      end if;
      arrived  <= next_arrived;
      farthest <= next_farthest;

      -- A laser is complete
      if in_valid = '1' and in_last = '1' then
        bank          <= not bank;
        arrived       <= (others => (others => '0'));
        farthest      <= (others => (others => '0'));
        pairing_bank  <= bank;
        pairing_laser <= in_laser;
        is_first      <= '1';
        first_place   <= (others => '0');
        second_place  <= (others => '0');
        has(0)        <= '1' when next_arrived(0) /= 0 else '0';
        has(1)        <= '1' when next_arrived(1) /= 0 else '0';
        if paper = '1' then
          phase  <= PAIRS;
          counts <= (others => to_unsigned(1, 4));
          base   <= next_farthest;
        else
          counts <= next_arrived;
          base   <= (others => (others => '0'));
          if next_arrived(0) /= 0 and next_arrived(1) /= 0 then
            phase <= PAIRS;
          elsif alone and next_arrived(0) /= 0 then
            phase <= FIRST_ALONE;
          elsif alone and next_arrived(1) /= 0 then
            phase <= SECOND_ALONE;
          else
            phase <= NOTHING;
          end if;
        end if;
      end if;

      if rst = '1' then
        bank      <= '0';
        arrived   <= (others => (others => '0'));
        farthest  <= (others => (others => '0'));
        phase     <= IDLE;
        out_valid <= '0';
      end if;
    end if;
  end process;

end architecture;
