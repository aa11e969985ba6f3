-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Time, and what depends on it.
--
-- Purpose     the time, compare, watchdog and reset_cause registers of soc.rdl
-- Rules       The watchdog bites in the microsecond after the written number of them has gone by. Its reset is for everything,
--             this block included, but for reset_cause.
-- Latency     0 from an access to its data; 1 from the end of a microsecond to the interrupt
-- Throughput  one access per clock
-- Resources   hw-ip/synth/resources.txt
-- Twin        none: karst_regs::soc names the registers

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.soc_map_pkg.all;

entity timer_watchdog is
  generic (
    G_CLOCKS_PER_US : positive range 1 to 65535 := 100     -- after a reset
  );
  port (
    clk            : in  std_ulogic;                       -- rising edge
    rst            : in  std_ulogic;                       -- synchronous, high: forgets everything
    access_read    : in  std_ulogic;                       -- one clock: a register is read
    write          : in  std_ulogic;                       -- one clock: a register is written
    address        : in  std_ulogic_vector(5 downto 0);    -- byte address of the register
    write_data     : in  std_ulogic_vector(31 downto 0);   -- what is written
    read_data      : out std_ulogic_vector(31 downto 0);   -- what the register holds; zero if it is none of these
    interrupt      : out std_ulogic;                       -- the time has come
    watchdog_reset : out std_ulogic                        -- one clock: resets everything
  );
end entity;

architecture rtl of timer_watchdog is

  signal clocks_per_us : unsigned(15 downto 0);
  signal wait_for      : unsigned(15 downto 0);  -- clocks to the end of this microsecond
  signal tick          : std_ulogic;             -- a microsecond is over
  signal now           : unsigned(63 downto 0);
  signal high_at_read  : unsigned(31 downto 0);  -- high word of the time when the low word was read
  signal compare       : unsigned(63 downto 0);
  signal watching      : std_ulogic;             -- the watchdog is on
  signal left          : unsigned(31 downto 0);  -- its microseconds
  signal bite          : std_ulogic;
  signal has_bitten    : std_ulogic;

begin

  watchdog_reset <= bite;
  tick           <= '1' when wait_for <= 1 else '0';

  read_p : process (all)
  begin
    read_data <= (others => '0');
    if unsigned(address) = TIME_LOW then
      read_data <= std_ulogic_vector(now(31 downto 0));
    elsif unsigned(address) = TIME_HIGH then
      read_data <= std_ulogic_vector(high_at_read);
    elsif unsigned(address) = COMPARE_LOW then
      read_data <= std_ulogic_vector(compare(31 downto 0));
    elsif unsigned(address) = COMPARE_HIGH then
      read_data <= std_ulogic_vector(compare(63 downto 32));
    elsif unsigned(address) = TIME_PRESCALER then
      read_data(TIME_PRESCALER_CLOCKS) <= std_ulogic_vector(clocks_per_us);
    elsif unsigned(address) = WATCHDOG and watching = '1' then
      read_data <= std_ulogic_vector(left);
    elsif unsigned(address) = RESET_CAUSE then
      read_data(RESET_CAUSE_WATCHDOG) <= has_bitten;
    end if;
  end process;

  time_p : process (clk)
  begin
    if rising_edge(clk) then
      interrupt <= '1' when now >= compare else '0';
      wait_for  <= wait_for - 1;
      if tick = '1' then
        wait_for <= clocks_per_us;
        now      <= now + 1;
      end if;
      if access_read = '1' and unsigned(address) = TIME_LOW then
        high_at_read <= now(63 downto 32);
      end if;
      if write = '1' and unsigned(address) = COMPARE_LOW then
        compare(31 downto 0) <= unsigned(write_data);
      end if;
      if write = '1' and unsigned(address) = COMPARE_HIGH then
        compare(63 downto 32) <= unsigned(write_data);
      end if;
      if write = '1' and unsigned(address) = TIME_PRESCALER then
        clocks_per_us <= unsigned(write_data(TIME_PRESCALER_CLOCKS));
      end if;
      if rst = '1' or bite = '1' then
        interrupt     <= '0';
        clocks_per_us <= to_unsigned(G_CLOCKS_PER_US, 16);
        wait_for      <= to_unsigned(G_CLOCKS_PER_US, 16);
        now           <= (others => '0');
        compare       <= (others => '1');
      end if;
    end if;
  end process;

  watchdog_p : process (clk)
  begin
    if rising_edge(clk) then
      bite <= '0';
      if watching = '1' and tick = '1' then
        if left = 0 then
          bite <= '1';
        else
          left <= left - 1;
        end if;
      end if;
      if write = '1' and unsigned(address) = WATCHDOG then
        watching <= '1';
        left     <= unsigned(write_data);
        bite     <= '0';
      end if;
      if rst = '1' or bite = '1' then
        watching <= '0';
        bite     <= '0';
      end if;
    end if;
  end process;

  cause_p : process (clk)
  begin
    if rising_edge(clk) then
      if write = '1' and unsigned(address) = RESET_CAUSE and write_data(RESET_CAUSE_WATCHDOG) = '1' then
        has_bitten <= '0';
      end if;
      if bite = '1' then
        has_bitten <= '1';
      end if;
      if rst = '1' then
        has_bitten <= '0';
      end if;
    end if;
  end process;

end architecture;
