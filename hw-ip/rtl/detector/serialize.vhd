-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Beats with hits in, single hits out.
--
-- Purpose     gives the hits of a beat one by one, from left to right; passes the end of a frame on
-- Latency     2
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

  subtype mask_t is std_ulogic_vector(G_PPC - 1 downto 0);

  -- The leftmost hit
  function lowest(mask : mask_t) return mask_t is
    variable result : mask_t;
    variable before : std_ulogic := '0';
  begin
    for lane in 0 to G_PPC - 1 loop
      result(lane) := mask(lane) and not before;
      before       := before or mask(lane);
    end loop;
    return result;
  end function;

  signal in_mask : mask_t;  -- lanes with a hit

  -- A beat, and which of its hits goes next: known one clock ahead
  signal valid   : std_ulogic;
  signal is_end  : std_ulogic;
  signal x       : std_ulogic_vector(in_x'range);
  signal y       : std_ulogic_vector(in_y'range);
  signal hits    : std_ulogic_vector(in_hits'range);
  signal chosen  : mask_t;  -- the next hit
  signal waiting : mask_t;  -- those behind it
  signal is_last : std_ulogic;  -- there is none behind it

begin

  mask_g : for lane in 0 to G_PPC - 1 generate
    in_mask(lane) <= in_hits(LANE_BITS * lane + 12) and not in_end;
  end generate;

  in_ready <= not valid or (room and is_last);

  beat_p : process (clk)
    variable rest : mask_t;
  begin
    if rising_edge(clk) then
      if in_ready = '1' then
        valid   <= in_valid;
        is_end  <= in_end;
        x       <= in_x;
        y       <= in_y;
        hits    <= in_hits;
        rest    := in_mask and not lowest(in_mask);
        chosen  <= lowest(in_mask);
        waiting <= rest;
        is_last <= nor rest;
      elsif room = '1' then
        rest    := waiting and not lowest(waiting);
        chosen  <= lowest(waiting);
        waiting <= rest;
        is_last <= nor rest;
      end if;
      if rst = '1' then
        valid <= '0';
      end if;
    end if;
  end process;

  output_p : process (clk)
    variable hit : std_ulogic_vector(11 downto 0);
    variable at  : std_ulogic_vector(in_x'range);
  begin
    if rising_edge(clk) then
      hit := (others => '0');
      at  := x;
      for lane in 0 to G_PPC - 1 loop
        if chosen(lane) = '1' then
          hit := hit or hits(LANE_BITS * lane + 11 downto LANE_BITS * lane);
          at  := at or std_ulogic_vector(to_unsigned(lane, in_x'length));
        end if;
      end loop;
      out_valid   <= valid and room;
      out_end     <= is_end;
      out_x       <= at;
      out_y       <= y;
      out_green   <= hit(11);
      out_clipped <= hit(10);
      out_weight  <= hit(9 downto 0);
      if rst = '1' then
        out_valid <= '0';
      end if;
    end if;
  end process;

end architecture;
