-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Bench of one math block: operands and results from a file that karst-cosim has written, with random pauses.
--
-- Purpose     the same comparison as math_harness.cpp, on the VHDL itself instead of its conversion to Verilog
-- Claims      every result is the crate's, in order, none is missing, none is left over; a result that is not taken stays

library ieee;
use ieee.std_logic_1164.all;
use ieee.math_real.all;
use std.env.finish;
use std.textio.all;

entity tb_math is
  generic (
    G_BLOCK     : natural range 0 to 14;  -- of math_blocks
    G_HANDSHAKE : boolean;               -- the output may be held back
    G_FILE      : string                 -- lines of operands and result in hexadecimal
  );
end entity;

architecture sim of tb_math is

  constant MOST_IDLE_CLOCKS : positive := 1000;

  signal clk       : std_ulogic := '0';
  signal rst       : std_ulogic := '1';
  signal in_valid  : std_ulogic := '0';
  signal in_ready  : std_ulogic;
  signal in_data   : std_ulogic_vector(191 downto 0);
  signal out_valid : std_ulogic;
  signal out_ready : std_ulogic := '0';
  signal out_data  : std_ulogic_vector(63 downto 0);

begin

  clk <= not clk after 5 ns;
  rst <= '0' after 32 ns;

  block_i : entity work.math_blocks
    generic map (G_BLOCK => G_BLOCK)
    port map (clk => clk, rst => rst, in_valid => in_valid, in_ready => in_ready, in_data => in_data,
              out_valid => out_valid, out_ready => out_ready, out_data => out_data);

  drive_p : process
    file vectors           : text open read_mode is G_FILE;
    variable row           : line;
    variable operands      : std_ulogic_vector(191 downto 0);
    variable seed_1        : positive := 1;
    variable seed_2        : positive := 2;
    variable random        : real;
  begin
    wait until rising_edge(clk) and rst = '0';
    while not endfile(vectors) loop
      readline(vectors, row);
      hread(row, operands);
      uniform(seed_1, seed_2, random);
      while random < 0.25 loop
        wait until rising_edge(clk);
        uniform(seed_1, seed_2, random);
      end loop;
      in_valid <= '1';
      in_data  <= operands;
      wait until rising_edge(clk) and in_ready = '1';
      in_valid <= '0';
      in_data  <= (others => 'X');
    end loop;
    wait;
  end process;

  check_p : process
    file vectors         : text open read_mode is G_FILE;
    variable row         : line;
    variable operands    : std_ulogic_vector(191 downto 0);
    variable expected    : std_ulogic_vector(63 downto 0);
    variable held        : std_ulogic_vector(63 downto 0);
    variable is_held     : boolean := false;
    variable idle_clocks : natural := 0;
    variable count       : natural := 0;
    variable seed_1      : positive := 3;
    variable seed_2      : positive := 4;
    variable random      : real;
  begin
    while not endfile(vectors) loop
      readline(vectors, row);
      hread(row, operands);
      hread(row, expected);
      idle_clocks := 0;
      loop
        uniform(seed_1, seed_2, random);
        out_ready <= '0' when G_HANDSHAKE and random < 0.25 else '1';
        wait until rising_edge(clk);
        if is_held then
          assert out_valid = '1' and out_data = held report "a result that is not taken changes" severity failure;
        end if;
        held    := out_data;
        is_held := out_valid = '1' and out_ready = '0';
        exit when rst = '0' and out_valid = '1' and out_ready = '1';
        idle_clocks := idle_clocks + 1;
        assert idle_clocks < MOST_IDLE_CLOCKS report "no result" severity failure;
      end loop;
      assert out_data = expected
        report to_hstring(operands) & ": expected " & to_hstring(expected) & ", found " & to_hstring(out_data)
        severity failure;
      count := count + 1;
    end loop;
    out_ready <= '1';
    for i in 1 to 100 loop
      wait until rising_edge(clk);
      assert out_valid = '0' report "a result is left over" severity failure;
    end loop;
    report "all " & integer'image(count) & " results equal";
    finish;
  end process;

end architecture;
