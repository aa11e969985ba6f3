-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- A value many clocks later.
--
-- Purpose     keeps values of a long pipeline in step, in a block memory instead of shift registers
-- Latency     G_CLOCKS
-- Throughput  one per clock. Reset starts the addresses; the values that come within G_CLOCKS after it mean nothing
-- Resources   a block memory per 36 bits, about ten LUT
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity delay_memory is
  generic (
    G_WIDTH  : positive;               -- bits of the value
    G_CLOCKS : positive range 4 to 32  -- how much later
  );
  port (
    clk   : in  std_ulogic;                               -- rising edge
    rst   : in  std_ulogic;                               -- synchronous, high
    value : in  std_ulogic_vector(G_WIDTH - 1 downto 0);  -- value
    later : out std_ulogic_vector(G_WIDTH - 1 downto 0)   -- the same, G_CLOCKS later
  );
end entity;

architecture rtl of delay_memory is

  -- More than needed: yosys makes a block memory of it only if it is large
  constant ADDRESS_BITS : positive := 7;
  -- Clocks in the memory: one to write, one to read and one for the output register are not
  constant STORED       : positive := G_CLOCKS - 2;

  type memory_t is array (0 to 2 ** ADDRESS_BITS - 1) of std_ulogic_vector(G_WIDTH - 1 downto 0);
  signal memory : memory_t;

  -- Both addresses never meet
  attribute no_rw_check : boolean;
  attribute no_rw_check of memory : signal is true;

  signal write_at : unsigned(ADDRESS_BITS - 1 downto 0);
  signal read_at  : unsigned(ADDRESS_BITS - 1 downto 0);
  signal fetched  : std_ulogic_vector(G_WIDTH - 1 downto 0);

begin

  memory_p : process (clk)
  begin
    if rising_edge(clk) then
      memory(to_integer(write_at)) <= value;
      fetched <= memory(to_integer(read_at));
      later   <= fetched;
    end if;
  end process;

  addresses_p : process (clk)
  begin
    if rising_edge(clk) then
      write_at <= write_at + 1;
      read_at  <= read_at + 1;
      if rst = '1' then
        write_at <= (others => '0');
        read_at  <= to_unsigned(2 ** ADDRESS_BITS - STORED, ADDRESS_BITS);
      end if;
    end if;
  end process;

end architecture;
