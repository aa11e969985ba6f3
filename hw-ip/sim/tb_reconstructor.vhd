-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Bench of the reconstructor: commands and points from files that karst-cosim has written, with random pauses.
--
-- Purpose     the same comparison as reconstructor_harness.cpp, on the VHDL itself instead of its conversion to Verilog
-- Claims      every point is the crate's, in order, none is missing, none is left over

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use ieee.math_real.all;
use std.env.finish;
use std.textio.all;

entity tb_reconstructor is
  generic (
    G_COMMANDS : string;  -- lines of the harness's commands in hexadecimal, the first word first
    G_POINTS   : string   -- lines of m_axis_tdata in hexadecimal
  );
end entity;

architecture sim of tb_reconstructor is

  constant MOST_IDLE_CLOCKS : positive := 5000;

  subtype word_t is std_ulogic_vector(31 downto 0);

  signal clk           : std_ulogic := '0';
  signal rst           : std_ulogic := '1';
  signal paper         : std_ulogic := '0';
  signal single_camera : std_ulogic := '0';
  signal range_min     : word_t     := (others => '0');
  signal range_max     : word_t     := (others => '0');
  signal chi2_max      : word_t     := (others => '0');
  signal write_valid   : std_ulogic := '0';
  signal write_table   : std_ulogic_vector(1 downto 0);
  signal write_entry   : std_ulogic_vector(10 downto 0);
  signal write_word    : std_ulogic_vector(4 downto 0);
  signal write_data    : word_t;
  signal s_axis_tvalid : std_ulogic := '0';
  signal s_axis_tready : std_ulogic;
  signal s_axis_tdata  : std_ulogic_vector(191 downto 0);
  signal s_axis_tlast  : std_ulogic;
  signal m_axis_tvalid : std_ulogic;
  signal m_axis_tdata  : std_ulogic_vector(223 downto 0);

  signal lasers_in  : natural := 0;
  signal points_out : natural := 0;

begin

  clk <= not clk after 5 ns;
  rst <= '0' after 32 ns;

  reconstructor_i : entity work.reconstructor
    port map (clk => clk, rst => rst, paper => paper, single_camera => single_camera, range_min => range_min,
              range_max => range_max, chi2_max => chi2_max, write_valid => write_valid, write_table => write_table,
              write_entry => write_entry, write_word => write_word, write_data => write_data,
              s_axis_tvalid => s_axis_tvalid, s_axis_tready => s_axis_tready, s_axis_tdata => s_axis_tdata,
              s_axis_tlast => s_axis_tlast, m_axis_tvalid => m_axis_tvalid, m_axis_tdata => m_axis_tdata);

  drive_p : process
    file commands      : text open read_mode is G_COMMANDS;
    variable row       : line;
    variable words     : std_ulogic_vector(255 downto 0);
    variable seed_1    : positive := 1;
    variable seed_2    : positive := 2;
    variable random    : real;

    impure function word(index : natural) return word_t is
    begin
      return words(255 - 32 * index downto 224 - 32 * index);
    end function;
  begin
    wait until rising_edge(clk) and rst = '0';
    while not endfile(commands) loop
      readline(commands, row);
      hread(row, words);
      case to_integer(unsigned(word(0))) is
        when 0 =>
          write_valid <= '1';
          write_table <= word(1)(1 downto 0);
          write_entry <= word(2)(10 downto 0);
          write_word  <= word(3)(4 downto 0);
          write_data  <= word(4);
          wait until rising_edge(clk);
          write_valid <= '0';
        when 1 =>
          paper         <= word(1)(0);
          single_camera <= word(2)(0);
          range_min     <= word(3);
          range_max     <= word(4);
          chi2_max      <= word(5);
        when 2 =>
          uniform(seed_1, seed_2, random);
          while random < 0.33 loop
            wait until rising_edge(clk);
            uniform(seed_1, seed_2, random);
          end loop;
          s_axis_tvalid <= '1';
          s_axis_tlast  <= word(1)(0);
          s_axis_tdata  <= word(7) & word(6) & word(5) & word(4) & word(3) & word(2);
          wait until rising_edge(clk) and s_axis_tready = '1';
          if word(1)(0) = '1' then
            lasers_in <= lasers_in + 1;
          end if;
          s_axis_tvalid <= '0';
          s_axis_tlast  <= 'X';
          s_axis_tdata  <= (others => 'X');
        when others =>
          wait until rising_edge(clk) and points_out = lasers_in;
      end case;
    end loop;
    wait;
  end process;

  check_p : process
    file points          : text open read_mode is G_POINTS;
    variable row         : line;
    variable expected    : std_ulogic_vector(223 downto 0);
    variable idle_clocks : natural;
  begin
    wait until rst = '0';
    while not endfile(points) loop
      readline(points, row);
      hread(row, expected);
      idle_clocks := 0;
      loop
        wait until rising_edge(clk);
        exit when m_axis_tvalid = '1';
        idle_clocks := idle_clocks + 1;
        assert idle_clocks < MOST_IDLE_CLOCKS report "no point" severity failure;
      end loop;
      assert m_axis_tdata = expected
        report "point " & integer'image(points_out) & ": expected " & to_hstring(expected) & ", found "
               & to_hstring(m_axis_tdata)
        severity failure;
      points_out <= points_out + 1;
    end loop;
    for i in 1 to 500 loop
      wait until rising_edge(clk);
      assert m_axis_tvalid = '0' report "a point is left over" severity failure;
    end loop;
    report "all " & integer'image(points_out) & " points equal";
    finish;
  end process;

end architecture;
