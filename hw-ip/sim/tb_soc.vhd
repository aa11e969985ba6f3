-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Bench of the SoC around the processor: processor_stub makes the accesses.
--
-- Claims      every word of the IP's registers is that of the software model, and so is its interrupt; the RAM keeps every
--             byte, over both ports, alone and in bursts of one word per clock; what is nowhere reads as zero; that, and an
--             answer that is an error, is told, and nothing else is; bytes that loop back over the serial line are the ones
--             sent, in bits of the right length; one too many, or one without stop bit, is told and harms no other; time,
--             timer interrupt and pins; clocks per access; the watchdog bites in time, not before and not if it is fed,
--             resets all, and tells
-- Format      one line per action, in hexadecimal, as karst-cosim writes them:
--             W address data strobe     write to the IP
--             R address data            read, and what has to come
--             T bit                     interrupt
--             C commits                 a commit takes effect
--             others                    for tb_registers

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use std.env.finish;
use std.textio.all;

use work.karst_map_pkg.all;
use work.karst_stub_pkg.all;
use work.processor_stub_pkg.all;
use work.soc_map_pkg.all;

entity tb_soc is
  generic (
    G_LASERS : positive range 2 to 720 := 12;  -- as the vectors were made for
    G_FILE   : string                          -- the vectors
  );
end entity;

architecture sim of tb_soc is

  constant CLOCKS_PER_US   : positive := 5;
  constant CLOCKS_PER_BIT  : positive := 8;
  constant LOG2_DEPTH      : positive := 4;
  constant MANY_BYTES      : positive := 2 ** LOG2_DEPTH + 16;  -- more than a buffer and the registers around it hold
  constant BYTE_CLOCKS     : positive := 10 * CLOCKS_PER_BIT + 1;
  constant MOST_CLOCKS     : positive := 50;                   -- for an access
  constant COMMIT_CLOCKS   : positive := 256 + 64 * G_LASERS + 20;
  constant BURST           : std_ulogic_vector(2 downto 0) := "010";
  constant LAST_OF_BURST   : std_ulogic_vector(2 downto 0) := "111";
  constant CLASSIC         : std_ulogic_vector(2 downto 0) := "000";

  subtype word_t is std_ulogic_vector(31 downto 0);

  signal clk          : std_ulogic := '0';
  signal rst          : std_ulogic := '1';
  signal clock        : natural := 0;
  signal loop_back    : boolean := true;
  signal rx           : std_ulogic;
  signal driven_rx    : std_ulogic := '1';
  signal tx           : std_ulogic;
  signal lasers       : std_ulogic;
  signal trigger      : std_ulogic;
  signal load_write   : std_ulogic := '0';
  signal load_address : std_ulogic_vector(15 downto 0) := (others => '0');
  signal load_data    : word_t := (others => '0');

  function word(value : natural) return word_t is
  begin
    return std_ulogic_vector(to_unsigned(value, 32));
  end function;

  -- Any word, another one for every place
  function pattern(place : natural) return word_t is
  begin
    return std_ulogic_vector(resize(to_unsigned(place + 1, 32) * 16#1E3779B1#, 32));
  end function;

begin

  clk   <= not clk after 5 ns;
  clock <= clock + 1 when rising_edge(clk);
  rx    <= tx when loop_back else driven_rx;

  soc_i : entity work.soc
    generic map (
      G_LASERS => G_LASERS, G_CLOCKS_PER_US => CLOCKS_PER_US, G_CLOCKS_PER_BIT => CLOCKS_PER_BIT, G_LOG2_DEPTH => LOG2_DEPTH)
    port map (
      clk => clk, rst => rst, uart_rx => rx, uart_tx => tx, lasers => lasers, trigger => trigger,
      s_axis_1_tvalid => '0', s_axis_1_tready => open, s_axis_1_tdata => (others => '0'), s_axis_1_tuser => '0',
      s_axis_1_tlast => '0',
      s_axis_2_tvalid => '0', s_axis_2_tready => open, s_axis_2_tdata => (others => '0'), s_axis_2_tuser => '0',
      s_axis_2_tlast => '0',
      load_write => load_write, load_address => load_address, load_data => load_data);

  check_p : process

    procedure wait_clocks(count : natural) is
    begin
      for i in 1 to count loop
        wait until rising_edge(clk);
      end loop;
    end procedure;

    -- An access of the data bus. Accesses without time between them follow each other without an idle clock.
    procedure bus_access(address : word_t; is_write : std_ulogic; data : word_t; strobe : std_ulogic_vector(3 downto 0);
                         found : out word_t) is
      variable left : natural := MOST_CLOCKS;
    begin
      stub_d_stb      <= '1';
      stub_d_we       <= is_write;
      stub_d_adr      <= address(31 downto 2);
      stub_d_dat_mosi <= data;
      stub_d_sel      <= strobe;
      loop
        wait until rising_edge(clk);
        exit when stub_d_ack = '1';
        left := left - 1;
        assert left > 0 report "no acknowledgement from " & to_hstring(address) severity failure;
      end loop;
      found      := stub_d_dat_miso;
      stub_d_stb <= '0';
    end procedure;

    procedure write(address : word_t; data : word_t; strobe : std_ulogic_vector(3 downto 0) := "1111") is
      variable ignored : word_t;
    begin
      bus_access(address, '1', data, strobe, ignored);
    end procedure;

    procedure read(address : word_t; found : out word_t) is
    begin
      bus_access(address, '0', (others => '0'), "1111", found);
    end procedure;

    procedure check(address : word_t; expected : word_t) is
      variable found : word_t;
    begin
      read(address, found);
      assert found = expected
        report to_hstring(address) & ": " & to_hstring(found) & " instead of " & to_hstring(expected) severity failure;
    end procedure;

    -- Address of a register of the peripherals
    function at(register_address : natural) return word_t is
    begin
      return word_t(unsigned(PERIPHERALS_BASE) + register_address);
    end function;

    procedure check_bit(what : string; found : std_ulogic; expected : std_ulogic) is
    begin
      assert found = expected
        report what & " is " & to_string(found) & " at clock " & to_string(clock) severity failure;
    end procedure;

    procedure check_registers is
      file vectors        : text;
      variable row        : line;
      variable kind       : character;
      variable address    : std_ulogic_vector(19 downto 0);
      variable data       : word_t;
      variable strobe     : std_ulogic_vector(3 downto 0);
      variable bit_wanted : std_ulogic_vector(3 downto 0);
      variable count      : natural := 0;
    begin
      file_open(vectors, G_FILE, read_mode);
      while not endfile(vectors) loop
        readline(vectors, row);
        read(row, kind);
        if kind = 'W' then
          hread(row, address);
          hread(row, data);
          hread(row, strobe);
          write(KARST_BASE or (x"000" & address), data, strobe);
        elsif kind = 'R' then
          hread(row, address);
          hread(row, data);
          check(KARST_BASE or (x"000" & address), data);
          count := count + 1;
        elsif kind = 'T' then
          hread(row, bit_wanted);
          -- A register behind the event, one behind the flag
          wait_clocks(3);
          check_bit("interrupt of the IP", stub_interrupts(0), bit_wanted(0));
        elsif kind = 'C' then
          wait_clocks(COMMIT_CLOCKS);
        end if;
      end loop;
      file_close(vectors);
      report to_string(count) & " words of the IP's registers, every bit equal";
    end procedure;

    procedure check_ram is
      constant LAST : natural := (PROGRAM_BYTES + DATA_BYTES) / 4 - 1;

      function ram(place : natural) return word_t is
      begin
        return word_t(unsigned(PROGRAM_BASE) + 4 * place);
      end function;

      procedure check_burst(first : natural; is_instruction : boolean) is
        variable start : natural;
      begin
        for place in first to first + 7 loop
          if is_instruction then
            stub_i_stb <= '1';
            stub_i_adr <= ram(place)(31 downto 2);
            stub_i_cti <= LAST_OF_BURST when place = first + 7 else BURST;
          else
            stub_d_stb <= '1';
            stub_d_we  <= '0';
            stub_d_adr <= ram(place)(31 downto 2);
            stub_d_cti <= LAST_OF_BURST when place = first + 7 else BURST;
          end if;
          if place = first then
            wait until rising_edge(clk);
            check_bit("acknowledgement", stub_i_ack or stub_d_ack, '0');
            start := clock;
          end if;
          wait until rising_edge(clk);
          if is_instruction then
            check_bit("acknowledgement of an instruction", stub_i_ack, '1');
            assert stub_i_dat_miso = pattern(place) report "instruction " & to_string(place) severity failure;
          else
            check_bit("acknowledgement of data", stub_d_ack, '1');
            assert stub_d_dat_miso = pattern(place) report "data " & to_string(place) severity failure;
          end if;
        end loop;
        assert clock - start = 8 report "the burst took " & to_string(clock - start) severity failure;
        stub_i_stb <= '0';
        stub_d_stb <= '0';
        stub_d_cti <= CLASSIC;
        wait until rising_edge(clk);
        check_bit("acknowledgement after a burst", stub_i_ack or stub_d_ack, '0');
      end procedure;

    begin
      for place in 0 to 63 loop
        check(ram(place), pattern(place));
      end loop;
      for i in 0 to 7 loop
        check_burst(8 * i, true);
        check_burst(8 * i, false);
      end loop;
      for place in LAST - 63 to LAST loop
        write(ram(place), not pattern(place));
        for byte in 0 to 3 loop
          write(ram(place), pattern(place), std_ulogic_vector(to_unsigned(2 ** byte, 4)));
        end loop;
      end loop;
      for place in LAST - 63 to LAST loop
        check(ram(place), pattern(place));
      end loop;
      check_burst(LAST - 7, true);
      -- Beyond the end, and nowhere
      write(ram(LAST + 1), x"FFFFFFFF");
      check(ram(LAST + 1), word(0));
      check(ram(0), pattern(0));
      for place in 0 to 2 loop
        write(word(4 * place), x"FFFFFFFF");
        check(word(4 * place), word(0));
      end loop;
      check(x"80000000", word(0));
      check(word_t(unsigned(KARST_BASE) + KARST_BYTES), word(0));
      check(word_t(unsigned(PERIPHERALS_BASE) + PERIPHERALS_BYTES), word(0));
      report "RAM: checked";
    end procedure;

    procedure check_uart is
      variable found    : word_t;
      variable start    : natural;
      variable count    : natural;
      constant RECEIVED : word_t := (UART_STATUS_RECEIVED => '1', others => '0');
      constant ROOM     : word_t := (UART_STATUS_ROOM => '1', others => '0');
      constant LOST     : word_t := (UART_STATUS_LOST => '1', others => '0');

      function valid_byte(byte : natural) return word_t is
        variable result : word_t := word(byte);
      begin
        result(UART_DATA_VALID) := '1';
        return result;
      end function;

    begin
      check(at(UART_DIVISOR), word(CLOCKS_PER_BIT));
      check(at(UART_STATUS), ROOM);
      check(at(UART_DATA), word(0));
      -- Every byte; each interrupt as long as there is what it is for
      for byte in 0 to 255 loop
        write(at(UART_INTERRUPT), word(1));
        write(at(UART_DATA), word(byte));
        check_bit("interrupt of an empty line", stub_interrupts(1), '0');
        wait_clocks(BYTE_CLOCKS + 10);
        check_bit("interrupt of a received byte", stub_interrupts(1), '1');
        check(at(UART_STATUS), ROOM or RECEIVED);
        check(at(UART_DATA), valid_byte(byte));
        wait_clocks(2);
        check_bit("interrupt after the byte was taken", stub_interrupts(1), '0');
        check(at(UART_DATA), word(0));
      end loop;
      write(at(UART_INTERRUPT), word(2));
      wait_clocks(2);
      check_bit("interrupt of room", stub_interrupts(1), '1');
      write(at(UART_INTERRUPT), word(0));
      wait_clocks(2);
      check_bit("interrupt that is not enabled", stub_interrupts(1), '0');

      -- Bits are as long as they are to be: 0x55 changes with every one
      for divisor in 4 to 6 loop
        write(at(UART_DIVISOR), word(divisor));
        write(at(UART_DATA), word(16#55#));
        wait until tx = '0';
        start := clock;
        for i in 1 to 9 loop
          wait until tx'event;
          assert clock - start = i * divisor
            report "bit " & to_string(i) & " ends after " & to_string(clock - start) severity failure;
        end loop;
        wait_clocks(4 * divisor);
        check(at(UART_DATA), valid_byte(16#55#));
      end loop;
      write(at(UART_DIVISOR), word(CLOCKS_PER_BIT));

      -- More bytes than the buffer takes: those before are there, in order
      for byte in 1 to MANY_BYTES loop
        write(at(UART_DATA), word(byte));
        wait_clocks(BYTE_CLOCKS + 20);
      end loop;
      check(at(UART_STATUS), ROOM or RECEIVED or LOST);
      count := 0;
      loop
        read(at(UART_DATA), found);
        exit when found(UART_DATA_VALID) = '0';
        count := count + 1;
        assert found = valid_byte(count) report "byte " & to_string(count) & ": " & to_hstring(found) severity failure;
      end loop;
      assert count >= 2 ** LOG2_DEPTH and count < MANY_BYTES
        report to_string(count) & " bytes were received" severity failure;
      check(at(UART_STATUS), ROOM or LOST);
      write(at(UART_STATUS), LOST);
      check(at(UART_STATUS), ROOM);

      -- No room: what is written then is not sent
      count := 0;
      loop
        read(at(UART_STATUS), found);
        exit when found(UART_STATUS_ROOM) = '0';
        count := count + 1;
        write(at(UART_DATA), word(count));
      end loop;
      assert count >= 2 ** LOG2_DEPTH and count < MANY_BYTES
        report to_string(count) & " bytes had room" severity failure;
      write(at(UART_DATA), word(16#BB#));
      for byte in 1 to count loop
        loop
          read(at(UART_DATA), found);
          exit when found(UART_DATA_VALID) = '1';
        end loop;
        assert found = valid_byte(byte) report "byte " & to_string(byte) & ": " & to_hstring(found) severity failure;
      end loop;
      wait_clocks(2 * BYTE_CLOCKS);
      check(at(UART_STATUS), ROOM);

      -- A line that stays low is one broken byte, and a short dip is nothing
      loop_back <= false;
      driven_rx <= '0';
      wait_clocks(40 * CLOCKS_PER_BIT);
      driven_rx <= '1';
      wait_clocks(20);
      check(at(UART_STATUS), ROOM or LOST);
      write(at(UART_STATUS), LOST);
      driven_rx <= '0';
      wait_clocks(CLOCKS_PER_BIT / 4);
      driven_rx <= '1';
      wait_clocks(BYTE_CLOCKS + 20);
      check(at(UART_STATUS), ROOM);
      loop_back <= true;
      report "serial line: checked";
    end procedure;

    procedure check_time is
      variable first  : word_t;
      variable second : word_t;
      variable start  : natural;
    begin
      check(at(TIME_PRESCALER), word(CLOCKS_PER_US));
      read(at(TIME_LOW), first);
      start := clock;
      wait_clocks(100 * CLOCKS_PER_US - 2);
      read(at(TIME_LOW), second);
      assert clock - start = 100 * CLOCKS_PER_US severity failure;
      assert unsigned(second) - unsigned(first) = 100 report "the time goes wrong" severity failure;
      check(at(TIME_HIGH), word(0));
      check(at(COMPARE_LOW), x"FFFFFFFF");
      check(at(COMPARE_HIGH), x"FFFFFFFF");
      check_bit("timer interrupt", stub_timer, '0');
      read(at(TIME_LOW), first);
      second := word_t(unsigned(first) + 50);
      write(at(COMPARE_LOW), second);
      write(at(COMPARE_HIGH), word(0));
      while stub_timer = '0' loop
        wait_clocks(1);
        assert clock - start < 200 * CLOCKS_PER_US report "no timer interrupt" severity failure;
      end loop;
      read(at(TIME_LOW), first);
      assert first = second report "the interrupt came at " & to_hstring(first) severity failure;
      wait_clocks(100);
      check_bit("timer interrupt that nobody has served", stub_timer, '1');
      write(at(COMPARE_HIGH), word(1));
      wait_clocks(2);
      check_bit("timer interrupt to come", stub_timer, '0');
      -- Another rate
      write(at(TIME_PRESCALER), word(1));
      wait_clocks(2 * CLOCKS_PER_US);
      read(at(TIME_LOW), first);
      wait_clocks(98);
      read(at(TIME_LOW), second);
      assert unsigned(second) - unsigned(first) = 100 report "the time goes wrong at another rate" severity failure;
      write(at(TIME_PRESCALER), word(CLOCKS_PER_US));
      report "time: checked";
    end procedure;

    -- Clocks per access, as doc/soc.md tells them
    procedure check_clocks is
      procedure measure(what : string; address : word_t; is_write : std_ulogic; expected : positive) is
        variable start : natural;
        variable found : word_t;
      begin
        wait_clocks(10);
        start := clock;
        bus_access(address, is_write, (others => '0'), "0000", found);
        assert clock - start = expected
          report what & " takes " & to_string(clock - start) & " clocks" severity failure;
      end procedure;
    begin
      for is_write in std_ulogic range '0' to '1' loop
        measure("RAM", DATA_BASE, is_write, 2);
        measure("a peripheral", at(PINS), is_write, 2);
        measure("nothing", word(0), is_write, 2);
        measure("a register of the IP", word_t(unsigned(KARST_BASE) + INTERRUPT_ENABLE), is_write, 6);
        measure("a setting of the IP", word_t(unsigned(KARST_BASE) + SETTINGS_INSTRUMENT_LASERS), is_write, 8);
      end loop;
      report "clocks per access: checked";
    end procedure;

    -- What fails is told by bus_error until it is cleared; what does not fail is not
    procedure check_errors is

      constant NONE   : word_t := (others => '0');
      constant FAILED : word_t := (BUS_ERROR_FAILED => '1', others => '0');

      procedure try(address : word_t; fails : boolean) is
        variable ignored : word_t;
      begin
        for is_write in std_ulogic range '0' to '1' loop
          bus_access(address, is_write, (others => '0'), "1111", ignored);
          if fails then
            check(at(BUS_ERROR), FAILED);
            write(at(BUS_ERROR), NONE);
            check(at(BUS_ERROR), FAILED);
            write(at(BUS_ERROR), FAILED);
          end if;
          check(at(BUS_ERROR), NONE);
        end loop;
      end procedure;

      constant REGISTER_OF_IP : word_t := word_t(unsigned(KARST_BASE) + INTERRUPT_ENABLE);
      constant SETTING        : word_t := word_t(unsigned(KARST_BASE) + SETTINGS_INSTRUMENT_LASERS);

    begin
      write(at(BUS_ERROR), FAILED);
      try(PROGRAM_BASE, false);
      try(word_t(unsigned(DATA_BASE) + DATA_BYTES - 4), false);
      try(at(PINS), false);
      try(word(0), true);
      try(x"80000000", true);
      try(word_t(unsigned(DATA_BASE) + DATA_BYTES), true);
      try(word_t(unsigned(KARST_BASE) + KARST_BYTES), true);
      try(word_t(unsigned(PERIPHERALS_BASE) + PERIPHERALS_BYTES), true);
      -- OKAY, EXOKAY, SLVERR, DECERR
      for response in 0 to 3 loop
        stub_response <= std_ulogic_vector(to_unsigned(response, 2));
        try(REGISTER_OF_IP, response >= 2);
        try(SETTING, response >= 2);
      end loop;
      stub_response <= "00";
      report "bus errors: checked";
    end procedure;

    procedure check_pins is
    begin
      for value in 0 to 7 loop
        write(at(PINS), word(value));
        wait_clocks(1);
        check_bit("lasers", lasers, word(value)(PINS_LASERS));
        check_bit("trigger", trigger, word(value)(PINS_TRIGGER));
        check(at(PINS), word(value mod 4));
      end loop;
      report "pins: checked";
    end procedure;

    procedure check_watchdog is
      variable start : natural;
      variable found : word_t;
    begin
      check(at(WATCHDOG), word(0));
      check(at(RESET_CAUSE), word(0));
      -- Fed in time it stays quiet
      for i in 1 to 5 loop
        write(at(WATCHDOG), word(20));
        for waiting in 1 to 19 * CLOCKS_PER_US loop
          wait_clocks(1);
          check_bit("reset", stub_reset, '0');
        end loop;
        read(at(WATCHDOG), found);
        assert unsigned(found) <= 2 report "what is left: " & to_hstring(found) severity failure;
      end loop;
      write(at(PINS), word(3));
      write(PROGRAM_BASE, x"12345678");
      write(at(WATCHDOG), word(20));
      start := clock;
      while stub_reset = '0' loop
        wait_clocks(1);
        assert clock - start < 22 * CLOCKS_PER_US report "the watchdog does not bite" severity failure;
      end loop;
      assert clock - start >= 20 * CLOCKS_PER_US report "the watchdog bites too early" severity failure;
      wait_clocks(1);
      check_bit("reset of more than a clock", stub_reset, '0');
      check_bit("lasers after the reset", lasers, '0');
      check_bit("trigger after the reset", trigger, '0');
      check(at(RESET_CAUSE), word(1));
      check(PROGRAM_BASE, x"12345678");
      check(at(WATCHDOG), word(0));
      -- It is off again
      for waiting in 1 to 100 * CLOCKS_PER_US loop
        wait_clocks(1);
        check_bit("reset", stub_reset, '0');
      end loop;
      check(at(RESET_CAUSE), word(1));
      write(at(RESET_CAUSE), word(1));
      check(at(RESET_CAUSE), word(0));
      -- A reset from outside leaves nothing of it
      write(at(WATCHDOG), word(0));
      wait until stub_reset = '1';
      wait_clocks(2);
      check(at(RESET_CAUSE), word(1));
      rst <= '1';
      wait_clocks(4);
      rst <= '0';
      wait_clocks(2);
      check(at(RESET_CAUSE), word(0));
      report "watchdog: checked";
    end procedure;

  begin
    -- The program comes from outside
    wait_clocks(4);
    for place in 0 to 63 loop
      load_write   <= '1';
      load_address <= std_ulogic_vector(to_unsigned(place, 16));
      load_data    <= pattern(place);
      wait_clocks(1);
    end loop;
    load_write <= '0';
    wait_clocks(4);
    rst <= '0';
    wait_clocks(4);
    assert stub_start = PROGRAM_BASE severity failure;

    check_registers;
    check_ram;
    check_uart;
    check_clocks;
    check_errors;
    check_time;
    check_pins;
    check_watchdog;
    finish;
  end process;

end architecture;
