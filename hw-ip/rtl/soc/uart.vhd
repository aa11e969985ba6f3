-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Serial line of the processor.
--
-- Purpose     the uart registers of soc.rdl: bytes from and to a line, with a buffer for each direction
-- Consists of uart_receive, uart_transmit, fifo
-- Latency     0 from an access to its data
-- Throughput  one access per clock
-- Resources   hw-ip/synth/resources.txt
-- Twin        none: karst_regs::soc names the registers

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

use work.soc_map_pkg.all;

entity uart is
  generic (
    G_CLOCKS_PER_BIT : positive range 4 to 65535 := 33;  -- after a reset
    G_LOG2_DEPTH     : positive range 1 to 12 := 11      -- of each buffer, bytes
  );
  port (
    clk         : in  std_ulogic;                        -- rising edge
    rst         : in  std_ulogic;                        -- synchronous, high: forgets everything
    access_read : in  std_ulogic;                        -- one clock: a register is read
    write       : in  std_ulogic;                        -- one clock: a register is written
    address     : in  std_ulogic_vector(5 downto 0);     -- byte address of the register
    write_data  : in  std_ulogic_vector(31 downto 0);    -- what is written
    read_data   : out std_ulogic_vector(31 downto 0);    -- what the register holds; zero if it is none of the line's
    interrupt   : out std_ulogic;                        -- what software waits for is there
    rx          : in  std_ulogic;                        -- the line, not synchronous
    tx          : out std_ulogic                         -- the line
  );
end entity;

architecture rtl of uart is

  signal clocks_per_bit   : unsigned(15 downto 0);
  signal on_received      : std_ulogic;
  signal on_room          : std_ulogic;
  signal lost             : std_ulogic;

  signal is_data          : std_ulogic;
  signal arrived          : std_ulogic;
  signal arrived_data     : std_ulogic_vector(7 downto 0);
  signal broken           : std_ulogic;
  signal buffer_has_room  : std_ulogic;
  signal received         : std_ulogic;
  signal received_data    : std_ulogic_vector(7 downto 0);
  signal take             : std_ulogic;
  signal put              : std_ulogic;
  signal room             : std_ulogic;
  signal to_send          : std_ulogic;
  signal to_send_data     : std_ulogic_vector(7 downto 0);
  signal sent             : std_ulogic;

begin

  is_data <= '1' when unsigned(address) = UART_DATA else '0';
  take    <= access_read and is_data;
  put     <= write and is_data;

  receive_i : entity work.uart_receive
    port map (
      clk => clk, rst => rst, clocks_per_bit => clocks_per_bit, rx => rx,
      valid => arrived, data => arrived_data, broken => broken);

  received_i : entity work.fifo
    generic map (G_WIDTH => 8, G_LOG2_DEPTH => G_LOG2_DEPTH)
    port map (
      clk => clk, rst => rst, in_valid => arrived, in_ready => buffer_has_room, in_data => arrived_data, room => open,
      out_valid => received, out_ready => take, out_data => received_data);

  to_send_i : entity work.fifo
    generic map (G_WIDTH => 8, G_LOG2_DEPTH => G_LOG2_DEPTH)
    port map (
      clk => clk, rst => rst, in_valid => put, in_ready => room, in_data => write_data(7 downto 0), room => open,
      out_valid => to_send, out_ready => sent, out_data => to_send_data);

  transmit_i : entity work.uart_transmit
    port map (
      clk => clk, rst => rst, clocks_per_bit => clocks_per_bit, in_valid => to_send, in_ready => sent,
      in_data => to_send_data, tx => tx);

  read_p : process (all)
  begin
    read_data <= (others => '0');
    if is_data = '1' then
      read_data(UART_DATA_VALID) <= received;
      if received = '1' then
        read_data(UART_DATA_DATA) <= received_data;
      end if;
    elsif unsigned(address) = UART_STATUS then
      read_data(UART_STATUS_RECEIVED) <= received;
      read_data(UART_STATUS_ROOM)     <= room;
      read_data(UART_STATUS_LOST)     <= lost;
    elsif unsigned(address) = UART_DIVISOR then
      read_data(UART_DIVISOR_CLOCKS) <= std_ulogic_vector(clocks_per_bit);
    elsif unsigned(address) = UART_INTERRUPT then
      read_data(UART_INTERRUPT_RECEIVED) <= on_received;
      read_data(UART_INTERRUPT_ROOM)     <= on_room;
    end if;
  end process;

  registers_p : process (clk)
  begin
    if rising_edge(clk) then
      interrupt <= (on_received and received) or (on_room and room);
      if write = '1' and unsigned(address) = UART_STATUS and write_data(UART_STATUS_LOST) = '1' then
        lost <= '0';
      end if;
      -- An event at the same clock stays
      if broken = '1' or (arrived = '1' and buffer_has_room = '0') then
        lost <= '1';
      end if;
      if write = '1' and unsigned(address) = UART_DIVISOR then
        clocks_per_bit <= unsigned(write_data(UART_DIVISOR_CLOCKS));
      end if;
      if write = '1' and unsigned(address) = UART_INTERRUPT then
        on_received <= write_data(UART_INTERRUPT_RECEIVED);
        on_room     <= write_data(UART_INTERRUPT_ROOM);
      end if;
      if rst = '1' then
        interrupt      <= '0';
        lost           <= '0';
        clocks_per_bit <= to_unsigned(G_CLOCKS_PER_BIT, 16);
        on_received    <= '0';
        on_room        <= '0';
      end if;
    end if;
  end process;

end architecture;
