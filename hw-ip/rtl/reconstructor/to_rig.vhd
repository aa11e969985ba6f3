-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Coordinates in a beam's frame to the rig's, one point per clock.
--
-- Purpose     origin + along * axis + up * axis + across * axis, and the range of the point
-- Latency     TO_RIG_LATENCY = 4
-- Throughput  one per clock. No reset: data only
-- Resources   9 multipliers of 33 x 32 bits
-- Twin        karst_core's calibration.rs: to_rig; reconstruct.rs: point

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.rounding.all;
use work.reconstructor_pkg.all;

entity to_rig is
  port (
    clk       : in  std_ulogic;                          -- rising edge
    enable    : in  std_ulogic;                          -- registers move
    range_min : in  signed(31 downto 0);                 -- least distance along the beam, mm, Q18.14, constant
    range_max : in  signed(31 downto 0);                 -- greatest, mm, Q18.14, constant
    place     : in  words_t(0 to PLACE_WORDS - 1);       -- the beam's origin, mm, Q12.20, and axes, Q2.30
    along     : in  signed(32 downto 0);                 -- mm, Q.16
    up        : in  signed(32 downto 0);                 -- mm, Q.16
    across    : in  signed(32 downto 0);                 -- mm, Q.16
    in_range  : out std_ulogic;                          -- the distance is in the range
    distance  : out signed(31 downto 0);                 -- along the beam, mm, Q18.14
    position  : out words_t(0 to 2)                      -- X, Y, Z, mm, Q18.14
  );
end entity;

architecture rtl of to_rig is

  type beam_t     is array (0 to 2) of signed(32 downto 0);
  type products_t is array (0 to 8) of signed(64 downto 0);

  signal beam          : beam_t;
  signal products      : products_t;  -- Q.16 times Q.30
  signal origin        : words_t(0 to 2);
  signal sums          : words_t(0 to 2);
  signal distance_here : signed(31 downto 0);
  signal is_inside        : signed(0 downto 0);
  signal is_inside_late   : signed(0 downto 0);

begin

  beam <= (along, up, across);

  coordinates_g : for i in 0 to 2 generate

    axes_g : for j in 0 to 2 generate
      product_i : entity work.multiply
        generic map (G_A_WIDTH => 33, G_B_WIDTH => 32)
        port map (clk => clk, enable => enable, a => beam(j), b => place(PLACE_AXES + 3 * j + i), product => products(3 * j + i));
    end generate;

    origin_i : entity work.delay
      generic map (G_WIDTH => 32, G_CLOCKS => 2)
      port map (clk => clk, enable => enable, value => place(PLACE_ORIGIN + i), later => origin(i));

    sum_p : process (clk)
    begin
      if rising_edge(clk) and enable = '1' then
        -- Q.16 times Q.30, each product at Q.14
        sums(i)     <= products(i)(63 downto 32) + products(3 + i)(63 downto 32) + products(6 + i)(63 downto 32)
                       + origin(i)(31 downto 6);
        position(i) <= sums(i);
      end if;
    end process;

  end generate;

  range_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      distance_here <= saturate(round_shift(along, 2), 32);
      is_inside(0)     <= '1' when distance_here >= range_min and distance_here <= range_max else '0';
    end if;
  end process;

  distance_i : entity work.delay
    generic map (G_WIDTH => 32, G_CLOCKS => TO_RIG_LATENCY - 1)
    port map (clk => clk, enable => enable, value => distance_here, later => distance);
  inside_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => TO_RIG_LATENCY - 2)
    port map (clk => clk, enable => enable, value => is_inside, later => is_inside_late);
  in_range <= is_inside_late(0);

end architecture;
