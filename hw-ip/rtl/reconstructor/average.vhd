-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The paper's method: the plain average of the crossings of one laser.
--
-- Purpose     sums the crossings of a laser from the first to the last, those that take part, and divides by their number
-- Latency     average_latency(G_BITS_PER_STAGE) = 3 + ceil(35 / (2 * G_BITS_PER_STAGE)), after the last crossing
-- Throughput  one crossing per clock
-- Resources   three divisions with denominators of 3 bits
-- Twin        karst_core's paper.rs: average

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use work.reconstructor_pkg.all;

entity average is
  generic (
    G_BITS_PER_STAGE : positive range 1 to 4  -- of wide divisions; twice that of these narrow ones
  );
  port (
    clk         : in  std_ulogic;            -- rising edge
    enable      : in  std_ulogic;            -- registers move
    in_valid    : in  std_ulogic;            -- a crossing is there
    first       : in  std_ulogic;            -- it is the first of its laser
    takes_part  : in  std_ulogic;            -- it counts
    along       : in  signed(32 downto 0);   -- mm, Q.16
    up          : in  signed(32 downto 0);   -- mm, Q.16
    across      : in  signed(32 downto 0);   -- mm, Q.16
    any         : out std_ulogic;            -- at least one crossing took part
    mean_along  : out signed(32 downto 0);   -- mm, Q.16
    mean_up     : out signed(32 downto 0);   -- mm, Q.16
    mean_across : out signed(32 downto 0)    -- mm, Q.16
  );
end entity;

architecture rtl of average is

  subtype sum_t  is signed(34 downto 0);
  type sums_t    is array (0 to 2) of sum_t;
  type values_t  is array (0 to 2) of signed(32 downto 0);
  type divided_t is array (0 to 2) of std_ulogic_vector(33 downto 0);

  signal values   : values_t;
  signal sums     : sums_t;
  signal count    : signed(2 downto 0);
  signal divided  : divided_t;
  signal any_here : signed(0 downto 0);
  signal any_late : signed(0 downto 0);

begin

  values <= (along, up, across);

  sum_p : process (clk)
    variable so_far       : sums_t;
    variable count_so_far : signed(2 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      if in_valid = '1' then
        so_far       := sums;
        count_so_far := count;
        if first = '1' then
          so_far       := (others => (others => '0'));
          count_so_far := (others => '0');
        end if;
        if takes_part = '1' then
          for i in 0 to 2 loop
            so_far(i) := so_far(i) + values(i);
          end loop;
          count_so_far := count_so_far + 1;
        end if;
        sums  <= so_far;
        count <= count_so_far;
      end if;
    end if;
  end process;

  divide_g : for i in 0 to 2 generate
    divide_i : entity work.divide
      generic map (G_NUMERATOR_WIDTH => 35, G_DENOMINATOR_WIDTH => 3, G_QUOTIENT_WIDTH => 34,
                   G_BITS_PER_STAGE => 2 * G_BITS_PER_STAGE)
      port map (clk => clk, enable => enable, rst => '0', in_valid => '1', numerator => std_ulogic_vector(sums(i)),
                denominator => std_ulogic_vector(count), out_valid => open, quotient => divided(i));
  end generate;

  any_here(0) <= '1' when count /= 0 else '0';
  any_i : entity work.delay
    generic map (G_WIDTH => 1, G_CLOCKS => average_latency(G_BITS_PER_STAGE) - 1)
    port map (clk => clk, enable => enable, value => any_here, later => any_late);

  any         <= any_late(0);
  mean_along  <= resize(signed(divided(0)), 33);
  mean_up     <= resize(signed(divided(1)), 33);
  mean_across <= resize(signed(divided(2)), 33);

end architecture;
