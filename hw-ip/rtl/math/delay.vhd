-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- A value some clocks later.
--
-- Purpose     keeps values of a pipeline in step
-- Latency     G_CLOCKS
-- Throughput  one per clock. No reset: data only
-- Resources   G_WIDTH shift registers of G_CLOCKS bits
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity delay is
  generic (
    G_WIDTH  : positive range 1 to 1024;  -- bits of the value
    G_CLOCKS : natural range 0 to 256     -- how much later
  );
  port (
    clk   : in  std_ulogic;                    -- rising edge
    enable : in  std_ulogic := '1';            -- registers move
    value : in  signed(G_WIDTH - 1 downto 0);  -- value
    later : out signed(G_WIDTH - 1 downto 0)   -- the same, G_CLOCKS later
  );
end entity;

architecture rtl of delay is

  type line_t is array (0 to G_CLOCKS) of signed(G_WIDTH - 1 downto 0);
  signal line : line_t;

begin

  line(0) <= value;

  stages_g : for i in 1 to G_CLOCKS generate
    line(i) <= line(i - 1) when rising_edge(clk) and enable = '1';
  end generate;

  later <= line(G_CLOCKS);

end architecture;
