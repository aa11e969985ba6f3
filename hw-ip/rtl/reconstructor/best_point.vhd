-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The best of a laser's pairs.
--
-- Purpose     the farthest point of the pairs of two cameras; without any, the farthest of one camera; without any, the
--             reason that is nearest to a point
-- Latency     2 from a laser's last pair
-- Throughput  one pair per clock
-- Resources   two comparisons of 32 bits, registers for two points
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

  -- The pair that comes is compared with the best so far and with the pair before it, which may become the best
  signal pair_valid   : std_ulogic;
  signal pair_first   : std_ulogic;
  signal pair_last    : std_ulogic;
  signal pair_counts  : std_ulogic;  -- it takes part
  signal pair_single  : std_ulogic;
  signal pair_reason  : outcome_t;
  signal pair_outcome : outcome_t;
  signal pair_along   : signed(31 downto 0);
  signal pair_payload : signed(G_PAYLOAD_WIDTH - 1 downto 0);
  signal beats_best   : std_ulogic;  -- farther than the best was when the pair came
  signal beats_before : std_ulogic;  -- farther than the pair before it
  signal was_better   : std_ulogic;  -- the pair before it became the best when it came

  signal so_far_or_reason : outcome_t;
  signal is_better    : std_ulogic;
  signal so_far       : outcome_t;
  signal best_single  : std_ulogic;
  signal best_along   : signed(31 downto 0);
  signal best         : signed(G_PAYLOAD_WIDTH - 1 downto 0);

begin

  pair_p : process (clk)
  begin
    if rising_edge(clk) then
      pair_valid   <= in_valid;
      pair_first   <= first;
      pair_last    <= last;
      pair_counts  <= takes_part;
      pair_single  <= single;
      pair_reason  <= reason;
      pair_outcome <= outcome;
      pair_along   <= along;
      pair_payload <= payload;
      beats_best   <= '1' when along > best_along else '0';
      beats_before <= '1' when along > pair_along else '0';
      was_better   <= is_better;
      if rst = '1' then
        pair_valid <= '0';
      end if;
    end if;
  end process;

  so_far_or_reason <= pair_reason when pair_first = '1' else so_far;
  is_better <= '1' when pair_valid = '1' and pair_counts = '1' and pair_outcome = POINT
                        and (so_far_or_reason /= POINT or (pair_single = best_single and
                             ((was_better = '1' and beats_before = '1') or (was_better = '0' and beats_best = '1')))) else '0';

  choose_p : process (clk)
  begin
    if rising_edge(clk) then
      out_valid <= pair_valid and pair_last;
      if pair_valid = '1' then
        so_far <= so_far_or_reason;
        if pair_counts = '1' and pair_outcome /= POINT and so_far_or_reason /= POINT and pair_outcome > so_far_or_reason then
          so_far <= pair_outcome;
        end if;
      end if;
      if is_better = '1' then
        so_far      <= POINT;
        best_single <= pair_single;
        best_along  <= pair_along;
        best        <= pair_payload;
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
