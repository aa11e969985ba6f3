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
    G_POINTS   : string   -- lines of m_axis_tlast and m_axis_tdata in hexadecimal
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
  signal spot_valid    : std_ulogic := '0';
  signal spot_bank     : std_ulogic;
  signal spot_camera   : std_ulogic;
  signal spot_laser    : std_ulogic_vector(9 downto 0);
  signal spot_slot     : std_ulogic_vector(1 downto 0);
  signal spot_data     : std_ulogic_vector(255 downto 0);
  signal mask_valid    : std_ulogic_vector(1 downto 0) := "00";
  signal mask_bank     : std_ulogic_vector(1 downto 0);
  signal mask_laser_1  : std_ulogic_vector(9 downto 0);
  signal mask_laser_2  : std_ulogic_vector(9 downto 0);
  signal mask_slots_1  : std_ulogic_vector(3 downto 0);
  signal mask_slots_2  : std_ulogic_vector(3 downto 0);
  signal start         : std_ulogic := '0';
  signal start_bank    : std_ulogic := '0';
  signal lasers        : std_ulogic_vector(10 downto 0);
  signal ready         : std_ulogic;
  signal busy          : std_ulogic;
  signal m_axis_tvalid : std_ulogic;
  signal m_axis_tdata  : std_ulogic_vector(223 downto 0);
  signal m_axis_tlast  : std_ulogic;

  signal frames_in  : natural    := 0;
  signal frames_out : natural    := 0;
  signal points_out : natural    := 0;
  signal dropping   : std_ulogic := '0';  -- points of a frame that a reset ends

begin

  clk <= not clk after 5 ns;

  reconstructor_i : entity work.reconstructor
    port map (clk => clk, rst => rst, paper => paper, single_camera => single_camera, range_min => range_min,
              range_max => range_max, chi2_max => chi2_max, write_valid => write_valid, write_table => write_table,
              write_entry => write_entry, write_word => write_word, write_data => write_data,
              spot_valid => spot_valid, spot_bank => spot_bank, spot_camera => spot_camera, spot_laser => spot_laser,
              spot_slot => spot_slot, spot_data => spot_data, mask_valid => mask_valid, mask_bank => mask_bank,
              mask_laser_1 => mask_laser_1, mask_laser_2 => mask_laser_2, mask_slots_1 => mask_slots_1,
              mask_slots_2 => mask_slots_2, start => start, start_bank => start_bank, lasers => lasers, ready => ready,
              busy => busy, m_axis_tvalid => m_axis_tvalid, m_axis_tdata => m_axis_tdata, m_axis_tlast => m_axis_tlast);

  drive_p : process
    file commands      : text open read_mode is G_COMMANDS;
    variable row       : line;
    variable words     : std_ulogic_vector(383 downto 0);
    variable seed_1    : positive := 1;
    variable seed_2    : positive := 2;
    variable random    : real;

    impure function word(index : natural) return word_t is
    begin
      return words(383 - 32 * index downto 352 - 32 * index);
    end function;
  begin
    for i in 1 to 3 loop
      wait until rising_edge(clk);
    end loop;
    rst <= '0';
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
          while word(1)(16) = '1' and ready = '0' loop
            wait until rising_edge(clk);
          end loop;
          spot_valid   <= word(1)(0);
          spot_bank    <= word(1)(1);
          spot_camera  <= word(1)(2);
          spot_slot    <= word(1)(4 downto 3);
          spot_laser   <= word(1)(15 downto 6);
          spot_data    <= word(11) & word(10) & word(9) & word(8) & word(7) & word(6) & word(5) & word(4);
          mask_valid   <= word(2)(1 downto 0);
          mask_bank    <= word(2)(3 downto 2);
          mask_laser_1 <= word(2)(13 downto 4);
          mask_laser_2 <= word(2)(23 downto 14);
          mask_slots_1 <= word(3)(3 downto 0);
          mask_slots_2 <= word(3)(11 downto 8);
          start        <= word(1)(16);
          start_bank   <= word(1)(17);
          lasers       <= word(1)(28 downto 18);
          wait until rising_edge(clk);
          if word(1)(16) = '1' then
            dropping <= word(1)(29);
            if word(1)(29) = '0' then
              frames_in <= frames_in + 1;
            end if;
          end if;
          spot_valid   <= '0';
          spot_data    <= (others => 'X');
          mask_valid   <= "00";
          mask_slots_1 <= (others => 'X');
          mask_slots_2 <= (others => 'X');
          start        <= '0';
          lasers       <= (others => 'X');
        when 3 =>
          wait until rising_edge(clk) and frames_out = frames_in;
        when 4 =>
          rst <= '1';
          wait until rising_edge(clk);
          rst      <= '0';
          dropping <= '0';
        when others =>
          for i in 0 to to_integer(unsigned(word(1))) loop
            wait until rising_edge(clk);
          end loop;
      end case;
    end loop;
    wait;
  end process;

  check_p : process
    file points          : text open read_mode is G_POINTS;
    variable row         : line;
    variable expected    : std_ulogic_vector(223 downto 0);
    variable idle_clocks : natural;
    variable is_last     : std_ulogic_vector(3 downto 0);
  begin
    wait until rst = '0';
    while not endfile(points) loop
      readline(points, row);
      hread(row, is_last);
      hread(row, expected);
      idle_clocks := 0;
      loop
        wait until rising_edge(clk);
        exit when m_axis_tvalid = '1' and dropping = '0' and rst = '0';
        idle_clocks := idle_clocks + 1;
        assert idle_clocks < MOST_IDLE_CLOCKS report "no point" severity failure;
      end loop;
      assert m_axis_tdata = expected
        report "point " & integer'image(points_out) & ": expected " & to_hstring(expected) & ", found "
               & to_hstring(m_axis_tdata)
        severity failure;
      assert m_axis_tlast = is_last(0) report "the end of the frame is not where it belongs" severity failure;
      assert busy = '1' report "a point, but not busy" severity failure;
      points_out <= points_out + 1;
      if m_axis_tlast = '1' then
        frames_out <= frames_out + 1;
      end if;
    end loop;
    for i in 1 to 500 loop
      wait until rising_edge(clk);
      assert m_axis_tvalid = '0' report "a point is left over" severity failure;
    end loop;
    report "all " & integer'image(points_out) & " points equal";
    finish;
  end process;

end architecture;
