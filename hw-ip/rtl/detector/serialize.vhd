-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Beats with hits in, single hits out.
--
-- Purpose     gives the hits of a beat one by one, from left to right; passes the end of a frame on
-- Latency     1
-- Throughput  one hit per clock
-- Resources   hw-ip/synth/resources.txt
-- Twin        none: the order of karst_core's Thresholds::scan_row

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity serialize is
  generic (
    G_PPC    : positive range 1 to 8 := 1;    -- pixels per beat: 1, 2, 4 or 8
    G_X_BITS : positive range 7 to 11 := 10;  -- widest image: 2 ** this
    G_Y_BITS : positive range 1 to 11 := 10   -- highest image: 2 ** this
  );
  port (
    clk         : in  std_ulogic;                                 -- rising edge
    rst         : in  std_ulogic;                                 -- synchronous, high: forgets what is under way
    in_valid    : in  std_ulogic;                                 -- beat is there; all as the outputs of segment
    in_ready    : out std_ulogic;                                 -- beat is taken if it is there
    in_end      : in  std_ulogic;
    in_x        : in  std_ulogic_vector(G_X_BITS downto 0);
    in_y        : in  std_ulogic_vector(G_Y_BITS downto 0);
    in_hits     : in  std_ulogic_vector(13 * G_PPC - 1 downto 0);
    room        : in  std_ulogic;                                 -- the blocks behind have room for a hit
    out_valid   : out std_ulogic;                                 -- hit, or the end of a frame
    out_end     : out std_ulogic;                                 -- end of a frame
    out_x       : out std_ulogic_vector(G_X_BITS downto 0);       -- column of the hit; at the end as in_x
    out_y       : out std_ulogic_vector(G_Y_BITS downto 0);       -- row of the hit; at the end as in_y
    out_green   : out std_ulogic;                                 -- the hit is green
    out_clipped : out std_ulogic;                                 -- the hit is clipped or a core
    out_weight  : out std_ulogic_vector(9 downto 0)               -- weight of the hit
  );
end entity;

architecture rtl of serialize is

  constant LANE_BITS : positive := 13;

  signal given   : std_ulogic_vector(G_PPC - 1 downto 0);  -- hits of the beat that are out already
  signal waiting : std_ulogic_vector(G_PPC - 1 downto 0);
  signal others_wait : std_ulogic;                         -- besides the leftmost waiting one

begin

  waiting_g : for lane in 0 to G_PPC - 1 generate
    waiting(lane) <= in_hits(LANE_BITS * lane + 12) and not given(lane) and not in_end;
  end generate;

  others_wait <= '1' when (unsigned(waiting) and (unsigned(waiting) - 1)) /= 0 else '0';
  in_ready    <= room and not others_wait;

  serialize_p : process (clk)
  begin
    if rising_edge(clk) then
      out_valid <= in_valid and room;
      out_end   <= in_end;
      out_x     <= in_x;
      out_y     <= in_y;
      out_green   <= '0';
      out_clipped <= '0';
      out_weight  <= (others => '0');
      for lane in G_PPC - 1 downto 0 loop
        if waiting(lane) = '1' then
          out_x       <= in_x or std_ulogic_vector(to_unsigned(lane, in_x'length));
          out_green   <= in_hits(LANE_BITS * lane + 11);
          out_clipped <= in_hits(LANE_BITS * lane + 10);
          out_weight  <= in_hits(LANE_BITS * lane + 9 downto LANE_BITS * lane);
        end if;
      end loop;
      if in_valid = '1' and room = '1' then
        -- The lowest waiting bit
        given <= given or (waiting and std_ulogic_vector(unsigned(not waiting) + 1));
        if others_wait = '0' then
          given <= (others => '0');
        end if;
      end if;
      if rst = '1' then
        out_valid <= '0';
        given     <= (others => '0');
      end if;
    end if;
  end process;

end architecture;
