-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The best of a laser's pairs.
--
-- Purpose     the farthest point of the pairs of two cameras; without any, the farthest of one camera; without any, the
--             reason that is nearest to a point
-- Latency     1 from a laser's last pair
-- Throughput  one pair per clock
-- Resources   one comparison of 32 bits, registers for a point
-- Twin        karst_core's reconstruct.rs: better, Candidates::weighted

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity best_point is
  generic (
    G_PAYLOAD_WIDTH : positive range 1 to 256  -- bits that go with a point
  );
  port (
    clk         : in  std_ulogic;                            -- rising edge
    rst         : in  std_ulogic;                            -- synchronous, high: forgets what is under way
    in_valid    : in  std_ulogic;                            -- a pair is there
    first       : in  std_ulogic;                            -- the first of its laser
    last        : in  std_ulogic;                            -- the last of its laser
    takes_part  : in  std_ulogic;                            -- it counts
    single      : in  std_ulogic;                            -- only one camera took part
    reason      : in  outcome_t;                             -- the laser's outcome if no pair counts
    outcome     : in  outcome_t;                             -- the pair's outcome
    along       : in  signed(31 downto 0);                   -- distance along the beam, mm, Q18.14
    payload     : in  signed(G_PAYLOAD_WIDTH - 1 downto 0);  -- the rest of the point
    out_valid   : out std_ulogic;                            -- a laser is done
    out_outcome : out outcome_t;                             -- POINT, or why not
    out_along   : out signed(31 downto 0);                   -- distance along the beam, mm, Q18.14
    out_payload : out signed(G_PAYLOAD_WIDTH - 1 downto 0)   -- the rest of the point
  );
end entity;

architecture rtl of best_point is

  signal so_far      : outcome_t;
  signal best_single : std_ulogic;
  signal best_along  : signed(31 downto 0);
  signal best        : signed(G_PAYLOAD_WIDTH - 1 downto 0);

begin

  choose_p : process (clk)
    variable before : outcome_t;
  begin
    if rising_edge(clk) then
      out_valid <= in_valid and last;
      if in_valid = '1' then
        before := reason when first = '1' else so_far;
        so_far <= before;
        if takes_part = '1' then
          if outcome = POINT then
            if before /= POINT or (along > best_along and single = best_single) then
              so_far      <= POINT;
              best_single <= single;
              best_along  <= along;
              best        <= payload;
            end if;
          elsif before /= POINT and outcome > before then
            so_far <= outcome;
          end if;
        end if;
      end if;
      if rst = '1' then
        out_valid <= '0';
      end if;
    end if;
  end process;

  out_outcome <= so_far;
  out_along   <= best_along;
  out_payload <= best;

end architecture;
