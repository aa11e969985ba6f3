-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Bench of the register block: random accesses and events that karst-cosim has written, with what has to follow.
--
-- Claims      every word read, the interrupt, the enable output, every word of a commit and the detectors' settings are
--             those of the software model, whatever the order and the delays of the AXI4-Lite channels; a response stays until it is taken, is OKAY, and
--             none comes unasked; a commit streams every word once
-- Format      one action or check per line, in hexadecimal:
--             W address data strobe     write
--             R address data            read, and what has to come
--             X address data address data   the same write and the same read twice, all at the same time
--             E events clocks           at each of so many clocks; bits: short row, long row, truncated, stray row, overflow, stalled (2 each, camera 1
--                                       low), unpaired, skipped
--             P record data             write a record of the result memory
--             S camera record data      write a spot
--             D                         the results are complete
--             F bits                    in_frame
--             I bit                     frame_idle
--             C commits                 a commit takes effect, and the number of the settings afterwards
--             L address data            what the blocks were told
--             K camera bits             the detector's settings, in the order of detector_settings, the first one highest
--             A camera laser azimuth    what the detector's memory was told
--             T bit, N bit              interrupt, enable

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use ieee.math_real.all;
use std.env.finish;
use std.textio.all;

entity tb_registers is
  generic (
    G_LASERS : positive range 1 to 720 := 4;  -- as the vectors were made for
    G_FILE   : string                         -- the vectors
  );
end entity;

architecture sim of tb_registers is

  constant SETTINGS_WORDS : positive := 256 + 64 * G_LASERS;
  constant MOST_CLOCKS    : positive := 200;  -- for an access

  constant X_BITS         : positive := 10;
  constant Y_BITS         : positive := 10;
  constant LASER_BITS     : positive := 4;
  constant DETECTOR_BITS  : positive := 272;

  type detector_t is array (0 to 1) of std_ulogic_vector(DETECTOR_BITS - 1 downto 0);
  type azimuth_t is array (0 to 1) of std_ulogic_vector(15 downto 0);
  type laser_t is array (0 to 1) of std_ulogic_vector(LASER_BITS - 1 downto 0);
  type azimuths_t is array (0 to 1, 0 to 2 ** LASER_BITS - 1) of std_ulogic_vector(15 downto 0);
  type words_t is array (0 to SETTINGS_WORDS - 1) of std_ulogic_vector(31 downto 0);

  signal clk              : std_ulogic := '0';
  signal rst              : std_ulogic := '1';
  signal awvalid          : std_ulogic := '0';
  signal awready          : std_ulogic;
  signal awaddr           : std_ulogic_vector(19 downto 0) := (others => '0');
  signal wvalid           : std_ulogic := '0';
  signal wready           : std_ulogic;
  signal wdata            : std_ulogic_vector(31 downto 0) := (others => '0');
  signal wstrb            : std_ulogic_vector(3 downto 0) := (others => '0');
  signal bvalid           : std_ulogic;
  signal bready           : std_ulogic := '0';
  signal bresp            : std_ulogic_vector(1 downto 0);
  signal arvalid          : std_ulogic := '0';
  signal arready          : std_ulogic;
  signal araddr           : std_ulogic_vector(19 downto 0) := (others => '0');
  signal rvalid           : std_ulogic;
  signal rready           : std_ulogic := '0';
  signal rdata            : std_ulogic_vector(31 downto 0);
  signal rresp            : std_ulogic_vector(1 downto 0);
  signal interrupt        : std_ulogic;
  signal enable           : std_ulogic;
  signal committing       : std_ulogic;
  signal frame_idle       : std_ulogic := '1';
  signal in_frame         : std_ulogic_vector(1 downto 0) := "00";
  signal events           : std_ulogic_vector(15 downto 0) := (others => '0');
  signal commits          : std_ulogic_vector(31 downto 0);
  signal load_valid       : std_ulogic;
  signal load_address     : std_ulogic_vector(15 downto 0);
  signal load_data        : std_ulogic_vector(31 downto 0);
  signal result_write     : std_ulogic := '0';
  signal spot_write       : std_ulogic_vector(0 to 1) := "00";
  signal record_index     : std_ulogic_vector(11 downto 0) := (others => '0');
  signal record_data      : std_ulogic_vector(255 downto 0) := (others => '0');
  signal results_done     : std_ulogic := '0';

  signal detector      : detector_t;
  signal azimuth_write : std_ulogic_vector(0 to 1);
  signal azimuth_laser : laser_t;
  signal azimuth       : azimuth_t;
  signal azimuths      : azimuths_t;
  signal loaded        : words_t := (others => (others => '0'));
  signal loaded_count  : natural := 0;  -- words since the start

begin

  clk <= not clk after 5 ns;
  rst <= '0' after 32 ns;

  registers_i : entity work.registers
    generic map (G_LASERS => G_LASERS, G_SLOTS => 4, G_PPC => 1)
    port map (
      clk => clk, rst => rst,
      s_axi_awvalid => awvalid, s_axi_awready => awready, s_axi_awaddr => awaddr,
      s_axi_wvalid => wvalid, s_axi_wready => wready, s_axi_wdata => wdata, s_axi_wstrb => wstrb,
      s_axi_bvalid => bvalid, s_axi_bready => bready, s_axi_bresp => bresp,
      s_axi_arvalid => arvalid, s_axi_arready => arready, s_axi_araddr => araddr,
      s_axi_rvalid => rvalid, s_axi_rready => rready, s_axi_rdata => rdata, s_axi_rresp => rresp,
      interrupt => interrupt, configured => open, enable => enable, committing => committing, frame_reset => open,
      frame_idle => frame_idle, in_frame => in_frame,
      event_short_row => events(1 downto 0), event_long_row => events(3 downto 2),
      event_truncated => events(5 downto 4), event_stray_row => events(7 downto 6),
      event_overflow => events(9 downto 8), event_stalled => events(11 downto 10),
      event_unpaired => events(12), event_skipped => events(13),
      cycles => open, commits => commits, load_valid => load_valid, load_address => load_address, load_data => load_data,
      result_write => result_write, result_record => record_index, result_data => record_data,
      spot_1_write => spot_write(0), spot_1_record => record_index, spot_1_data => record_data,
      spot_2_write => spot_write(1), spot_2_record => record_index, spot_2_data => record_data,
      results_done => results_done);

  blocks_p : process (clk)
  begin
    if rising_edge(clk) and load_valid = '1' then
      loaded(to_integer(unsigned(load_address))) <= load_data;
      loaded_count                               <= loaded_count + 1;
    end if;
  end process;

  detectors_g : for camera in 0 to 1 generate
    signal bits : std_ulogic_vector(DETECTOR_BITS - 1 downto 0);
  begin

    settings_i : entity work.detector_settings
      generic map (G_CAMERA => camera, G_X_BITS => X_BITS, G_Y_BITS => Y_BITS, G_LASER_BITS => LASER_BITS)
      port map (
        clk => clk, load_valid => load_valid, load_address => load_address, load_data => load_data,
        cfg_width => bits(271 downto 261), cfg_height => bits(260 downto 250),
        cfg_green_min_0 => bits(249 downto 242), cfg_green_min_1 => bits(241 downto 234),
        cfg_excess_min_0 => bits(233 downto 225), cfg_excess_min_1 => bits(224 downto 216),
        cfg_saturation_min => bits(215 downto 208), cfg_clip_min => bits(207 downto 200),
        cfg_clipped_weight => bits(199 downto 191),
        cfg_centre_x => bits(190 downto 176), cfg_centre_y => bits(175 downto 161),
        cfg_mirror_radius => bits(160 downto 145), cfg_inner_radius => bits(144 downto 129),
        cfg_cluster_gap => bits(128 downto 118), cfg_min_pixels => bits(117 downto 102),
        cfg_clockwise => bits(101), cfg_lasers => bits(100 downto 96),
        cfg_first_edge => bits(95 downto 80), cfg_sector_half_width => bits(79 downto 64),
        cfg_noise_floor => bits(63 downto 32), cfg_noise => bits(31 downto 0),
        cfg_azimuth_write => azimuth_write(camera), cfg_azimuth_laser => azimuth_laser(camera),
        cfg_azimuth => azimuth(camera));

    detector(camera) <= bits;

  end generate;

  azimuths_p : process (clk)
  begin
    if rising_edge(clk) then
      for camera in 0 to 1 loop
        if azimuth_write(camera) = '1' then
          azimuths(camera, to_integer(unsigned(azimuth_laser(camera)))) <= azimuth(camera);
        end if;
      end loop;
    end if;
  end process;

  -- Responses stay until they are taken
  stable_p : process (clk)
    variable b_held : boolean := false;
    variable r_held : boolean := false;
    variable data   : std_ulogic_vector(31 downto 0);
  begin
    if rising_edge(clk) and rst = '0' then
      assert not b_held or bvalid = '1' report "a write response is withdrawn" severity failure;
      assert not r_held or (rvalid = '1' and rdata = data) report "a read response changes" severity failure;
      assert bvalid = '0' or bresp = "00" report "a write is not OKAY" severity failure;
      assert rvalid = '0' or rresp = "00" report "a read is not OKAY" severity failure;
      b_held := bvalid = '1' and bready = '0';
      r_held := rvalid = '1' and rready = '0';
      data   := rdata;
    end if;
  end process;

  drive_p : process
    file vectors           : text open read_mode is G_FILE;
    variable row           : line;
    variable action        : character;
    variable address       : std_ulogic_vector(19 downto 0);
    variable other_address : std_ulogic_vector(19 downto 0);
    variable index         : std_ulogic_vector(11 downto 0);
    variable word_index    : std_ulogic_vector(15 downto 0);
    variable data          : std_ulogic_vector(31 downto 0);
    variable expected      : std_ulogic_vector(31 downto 0);
    variable strobe        : std_ulogic_vector(3 downto 0);
    variable bit_value     : std_ulogic_vector(3 downto 0);
    variable bits          : std_ulogic_vector(15 downto 0);
    variable new_record    : std_ulogic_vector(255 downto 0);
    variable held_bits     : std_ulogic_vector(DETECTOR_BITS - 1 downto 0);
    variable camera        : natural;
    variable loaded_before : natural := 0;
    variable count         : natural := 0;
    variable seed_1        : positive := 1;
    variable seed_2        : positive := 2;

    impure function chance return boolean is
      variable random : real;
    begin
      uniform(seed_1, seed_2, random);
      return random < 0.4;
    end function;

    procedure wait_clocks(clocks : natural) is
    begin
      for i in 1 to clocks loop
        wait until rising_edge(clk);
      end loop;
    end procedure;

    -- As many writes of data to address and, at the same time, reads of other_address; a second one may start before the
    -- first one's response is taken
    procedure access_bus(writes, reads : natural range 0 to 2) is
      variable aw_to_send : natural := writes;
      variable w_to_send  : natural := writes;
      variable b_to_come  : natural := writes;
      variable ar_to_send : natural := reads;
      variable r_to_come  : natural := reads;
      variable clocks     : natural := 0;
    begin
      awaddr <= address;
      wdata  <= data;
      wstrb  <= strobe;
      araddr <= other_address;
      while b_to_come > 0 or r_to_come > 0 loop
        if aw_to_send > 0 and chance then
          awvalid <= '1';
        end if;
        if w_to_send > 0 and chance then
          wvalid <= '1';
        end if;
        if ar_to_send > 0 and chance then
          arvalid <= '1';
        end if;
        bready <= '1' when chance else '0';
        rready <= '1' when chance else '0';
        wait until rising_edge(clk);
        if bvalid = '1' then
          assert b_to_come > aw_to_send and b_to_come > w_to_send report "a write response comes unasked" severity failure;
          if bready = '1' then
            b_to_come := b_to_come - 1;
          end if;
        end if;
        if rvalid = '1' then
          assert r_to_come > ar_to_send report "a read response comes unasked" severity failure;
          assert rdata = expected
            report to_hstring(other_address) & ": expected " & to_hstring(expected) & ", found " & to_hstring(rdata)
            severity failure;
          if rready = '1' then
            r_to_come := r_to_come - 1;
          end if;
        end if;
        if awvalid = '1' and awready = '1' then
          aw_to_send := aw_to_send - 1;
          awvalid    <= '0';
        end if;
        if wvalid = '1' and wready = '1' then
          w_to_send := w_to_send - 1;
          wvalid    <= '0';
        end if;
        if arvalid = '1' and arready = '1' then
          ar_to_send := ar_to_send - 1;
          arvalid    <= '0';
        end if;
        clocks := clocks + 1;
        assert clocks < MOST_CLOCKS report "no response" severity failure;
        wait for 1 ns;
      end loop;
      bready <= '0';
      rready <= '0';
      -- A command has its effect
      wait_clocks(4);
      wait for 1 ns;
    end procedure;

  begin
    wait until rising_edge(clk) and rst = '0';
    while not endfile(vectors) loop
      readline(vectors, row);
      read(row, action);
      case action is
        when 'W' =>
          hread(row, address);
          hread(row, data);
          hread(row, strobe);
          access_bus(writes => 1, reads => 0);
        when 'R' =>
          hread(row, other_address);
          hread(row, expected);
          access_bus(writes => 0, reads => 1);
        when 'X' =>
          hread(row, address);
          hread(row, data);
          hread(row, other_address);
          hread(row, expected);
          strobe := "1111";
          access_bus(writes => 2, reads => 2);
        when 'E' =>
          hread(row, bits);
          hread(row, word_index);
          events <= bits;
          wait_clocks(to_integer(unsigned(word_index)));
          events <= (others => '0');
          wait_clocks(2);
        when 'P' =>
          hread(row, index);
          hread(row, new_record);
          record_index <= index;
          record_data  <= new_record;
          result_write <= '1';
          wait until rising_edge(clk);
          result_write <= '0';
          wait_clocks(3);
        when 'S' =>
          hread(row, bit_value);
          hread(row, index);
          hread(row, new_record);
          record_index <= index;
          record_data  <= new_record;
          spot_write(to_integer(unsigned(bit_value))) <= '1';
          wait until rising_edge(clk);
          spot_write <= "00";
          wait_clocks(3);
        when 'D' =>
          results_done <= '1';
          wait until rising_edge(clk);
          results_done <= '0';
          wait_clocks(3);
        when 'F' =>
          hread(row, bit_value);
          in_frame <= bit_value(1 downto 0);
          wait until rising_edge(clk);
        when 'I' =>
          hread(row, bit_value);
          frame_idle <= bit_value(0);
          wait until rising_edge(clk);
        when 'C' =>
          hread(row, expected);
          for i in 1 to SETTINGS_WORDS + 10 loop
            wait until rising_edge(clk);
          end loop;
          assert committing = '0' and commits = expected report "a commit does not take effect" severity failure;
          assert loaded_count = loaded_before + SETTINGS_WORDS report "not every word once" severity failure;
          loaded_before := loaded_count;
        when 'L' =>
          hread(row, word_index);
          hread(row, expected);
          assert loaded(to_integer(unsigned(word_index))) = expected
            report "settings word " & to_hstring(word_index) & ": expected " & to_hstring(expected) & ", found " &
                   to_hstring(loaded(to_integer(unsigned(word_index))))
            severity failure;
        when 'K' =>
          hread(row, bit_value);
          hread(row, held_bits);
          camera := to_integer(unsigned(bit_value));
          assert detector(camera) = held_bits
            report "detector " & to_hstring(bit_value) & ": expected " & to_hstring(held_bits) & ", found " &
                   to_hstring(detector(camera))
            severity failure;
        when 'A' =>
          hread(row, bit_value);
          camera := to_integer(unsigned(bit_value));
          hread(row, bit_value);
          hread(row, word_index);
          assert azimuths(camera, to_integer(unsigned(bit_value))) = word_index
            report "azimuth of laser " & to_hstring(bit_value) & ": expected " & to_hstring(word_index)
            severity failure;
        when 'T' =>
          hread(row, bit_value);
          assert interrupt = bit_value(0) report "interrupt: expected " & to_hstring(bit_value) severity failure;
        when 'N' =>
          hread(row, bit_value);
          assert enable = bit_value(0) report "enable: expected " & to_hstring(bit_value) severity failure;
        when others =>
          report "unknown action " & action severity failure;
      end case;
      assert loaded_count = loaded_before or committing = '1' report "settings change without a commit" severity failure;
      count := count + 1;
    end loop;
    report integer'image(count) & " actions and checks, everything as in the model";
    finish;
  end process;

end architecture;
