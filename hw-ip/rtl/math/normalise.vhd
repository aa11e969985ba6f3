-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- A word shifted until its top bit is set, one per clock.
--
-- Purpose     the first step of a reciprocal or a root of few bits
-- Method      five multiplexers, by half of what is left each
-- Latency     2
-- Throughput  one per clock, no stall. No reset: data only
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_math::normalise

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity normalise is
  port (
    clk        : in  std_ulogic;             -- rising edge
    enable     : in  std_ulogic := '1';      -- registers move
    value      : in  unsigned(31 downto 0);  -- zero counts as one
    normalised : out unsigned(31 downto 0);  -- value * 2 ** shift, at least 2 ** 31
    shift      : out unsigned(4 downto 0)    -- by how many bits
  );
end entity;

architecture rtl of normalise is

  signal half_way : unsigned(31 downto 0);
  signal by_8     : unsigned(1 downto 0);

begin

  normalise_p : process (clk)
    variable word : unsigned(31 downto 0);
  begin
    if rising_edge(clk) and enable = '1' then
      word := value;
      by_8 <= "00";
      if word(31 downto 16) = 0 then
        by_8(1) <= '1';
        word    := shift_left(word, 16);
      end if;
      if word(31 downto 24) = 0 then
        by_8(0) <= '1';
        word    := shift_left(word, 8);
      end if;
      half_way <= word;

      word  := half_way;
      shift <= by_8 & "000";
      if word(31 downto 28) = 0 then
        shift(2) <= '1';
        word     := shift_left(word, 4);
      end if;
      if word(31 downto 30) = 0 then
        shift(1) <= '1';
        word     := shift_left(word, 2);
      end if;
      if word(31) = '0' then
        shift(0) <= '1';
        word     := shift_left(word, 1);
      end if;
      normalised <= '1' & word(30 downto 0);
    end if;
  end process;

end architecture;
