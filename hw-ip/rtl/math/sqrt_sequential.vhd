-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Integer square root in little area, one at a time.
--
-- Purpose     the results of sqrt where one every few dozen clocks is enough
-- Method      non-restoring, one bit of the root per clock, with the one adder of a stage of sqrt
-- Latency     ceil(G_WIDTH / 2) + 1 from the clock that takes the radicand, and one more if G_ROUND
-- Throughput  one per latency + 1
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_math::sqrt_floor, karst_math::sqrt_round

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity sqrt_sequential is
  generic (
    G_WIDTH : positive range 2 to 64 := 64;  -- bits of the radicand
    G_ROUND : boolean := false               -- round to the nearest integer instead of down
  );
  port (
    clk       : in  std_ulogic;                                       -- rising edge
    rst       : in  std_ulogic;                                       -- synchronous, high: forgets what is under way
    in_valid  : in  std_ulogic;                                       -- radicand is there
    in_ready  : out std_ulogic;                                       -- radicand is taken if it is there
    radicand  : in  std_ulogic_vector(G_WIDTH - 1 downto 0);          -- unsigned
    out_valid : out std_ulogic;                                       -- root is there, until it is taken
    out_ready : in  std_ulogic;                                       -- root is taken if it is there
    root      : out std_ulogic_vector((G_WIDTH + 1) / 2 - 1 downto 0) -- unsigned
  );
end entity;

architecture rtl of sqrt_sequential is

  constant ROOT_BITS : positive := (G_WIDTH + 1) / 2;
  constant STEPS     : positive := ROOT_BITS + boolean'pos(G_ROUND);

  signal remainder : unsigned(STEPS + 1 downto 0);  -- two's complement
  signal partial   : unsigned(STEPS - 1 downto 0);  -- the bits of the root so far
  signal rest      : unsigned(2 * STEPS - 1 downto 0);
  signal steps_left : natural range 0 to STEPS;
  signal done       : std_ulogic;

  -- One step, as in sqrt
  signal pair            : unsigned(1 downto 0);
  signal root_or_inverse : unsigned(STEPS - 1 downto 0);
  signal sum             : unsigned(STEPS downto 0);

begin

  pair            <= rest(rest'high downto rest'high - 1);
  root_or_inverse <= not partial when remainder(remainder'high) = '1' else partial;
  sum             <= (remainder(STEPS - 1 downto 0) & '0') - (root_or_inverse & (pair(1) nor pair(0)));

  step_p : process (clk)
  begin
    if rising_edge(clk) then
      if steps_left > 0 then
        remainder  <= sum(STEPS downto 1) & (pair(1) xnor pair(0)) & not pair(0);
        partial    <= partial(STEPS - 2 downto 0) & not sum(STEPS);
        rest       <= shift_left(rest, 2);
        steps_left <= steps_left - 1;
        if steps_left = 1 then
          done <= '1';
        end if;
      elsif done = '1' then
        done <= not out_ready;
      elsif in_valid = '1' then
        remainder  <= (others => '0');
        partial    <= (others => '0');
        rest       <= shift_left(resize(unsigned(radicand), rest'length), 2 * (STEPS - ROOT_BITS));
        steps_left <= STEPS;
      end if;
      if rst = '1' then
        steps_left <= 0;
        done       <= '0';
      end if;
    end if;
  end process;

  in_ready  <= '1' when steps_left = 0 and done = '0' else '0';
  out_valid <= done;

  floor_g : if not G_ROUND generate
    root <= std_ulogic_vector(partial);
  end generate;

  round_g : if G_ROUND generate
    signal floor : unsigned(ROOT_BITS - 1 downto 0);
  begin
    floor <= partial(STEPS - 1 downto 1);
    root  <= std_ulogic_vector(floor + 1) when partial(0) = '1' and not floor /= 0 else
             std_ulogic_vector(floor);
  end generate;

end architecture;
