-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- AXI4-Lite slave, one access at a time.
--
-- Purpose     from the five channels of AXI4-Lite to requests that are answered one by one
-- Rules       Address and data of a write may come in any order. A write and a read that wait at the same time take turns.
--             Every answer is OKAY.
-- Latency     2 from the last of address and data to the request, 1 from the answer to the response
-- Throughput  one access at a time
-- Resources   about 110 FF and 40 LUT
-- Twin        none: karst_regs::RegisterBus is what software sees of it

library ieee;
use ieee.std_logic_1164.all;

entity axi_lite_slave is
  generic (
    G_ADDRESS_BITS : positive range 3 to 32 := 20  -- bits of a byte address
  );
  port (
    clk           : in  std_ulogic;                                      -- rising edge
    rst           : in  std_ulogic;                                      -- synchronous, high: forgets what is under way

    -- AXI4-Lite
    s_axi_awvalid : in  std_ulogic;                                      -- write address is there
    s_axi_awready : out std_ulogic;                                      -- it is taken if it is there
    s_axi_awaddr  : in  std_ulogic_vector(G_ADDRESS_BITS - 1 downto 0);  -- byte address; the low two bits are ignored
    s_axi_wvalid  : in  std_ulogic;                                      -- write data are there
    s_axi_wready  : out std_ulogic;                                      -- they are taken if they are there
    s_axi_wdata   : in  std_ulogic_vector(31 downto 0);                  -- the data
    s_axi_wstrb   : in  std_ulogic_vector(3 downto 0);                   -- bytes to be written
    s_axi_bvalid  : out std_ulogic;                                      -- write response is there, until it is taken
    s_axi_bready  : in  std_ulogic;                                      -- it is taken if it is there
    s_axi_bresp   : out std_ulogic_vector(1 downto 0);                   -- OKAY
    s_axi_arvalid : in  std_ulogic;                                      -- read address is there
    s_axi_arready : out std_ulogic;                                      -- it is taken if it is there
    s_axi_araddr  : in  std_ulogic_vector(G_ADDRESS_BITS - 1 downto 0);  -- byte address; the low two bits are ignored
    s_axi_rvalid  : out std_ulogic;                                      -- read response is there, until it is taken
    s_axi_rready  : in  std_ulogic;                                      -- it is taken if it is there
    s_axi_rdata   : out std_ulogic_vector(31 downto 0);                  -- the data
    s_axi_rresp   : out std_ulogic_vector(1 downto 0);                   -- OKAY

    -- Requests
    request       : out std_ulogic;                                      -- an access; it stays, as all that follows, until it is answered
    is_write      : out std_ulogic;                                      -- it is a write
    address       : out std_ulogic_vector(G_ADDRESS_BITS - 1 downto 0);  -- of a word
    write_data    : out std_ulogic_vector(31 downto 0);                  -- to be written
    write_strobe  : out std_ulogic_vector(3 downto 0);                   -- bytes to be written
    answered      : in  std_ulogic;                                      -- one clock, with request: the access is done
    read_data     : in  std_ulogic_vector(31 downto 0)                   -- with answered, if it is a read
  );
end entity;

architecture rtl of axi_lite_slave is

  constant OKAY : std_ulogic_vector(1 downto 0) := "00";

  subtype address_t is std_ulogic_vector(G_ADDRESS_BITS - 1 downto 0);

  -- What has been taken from the channels and is not answered yet
  signal write_address      : address_t;
  signal write_address_held : std_ulogic;
  signal write_data_held    : std_ulogic;
  signal read_address       : address_t;
  signal read_address_held  : std_ulogic;

  signal under_way   : std_ulogic;  -- a request is to be answered
  signal writing     : std_ulogic;  -- it is a write; without one, the last one was
  signal write_waits : std_ulogic;
  signal read_waits  : std_ulogic;
  signal bvalid      : std_ulogic;
  signal rvalid      : std_ulogic;

begin

  s_axi_awready <= not write_address_held;
  s_axi_wready  <= not write_data_held;
  s_axi_arready <= not read_address_held;
  s_axi_bvalid  <= bvalid;
  s_axi_rvalid  <= rvalid;
  s_axi_bresp   <= OKAY;
  s_axi_rresp   <= OKAY;

  request  <= under_way;
  is_write <= writing;
  address  <= write_address(G_ADDRESS_BITS - 1 downto 2) & "00" when writing = '1' else
              read_address(G_ADDRESS_BITS - 1 downto 2) & "00";

  -- A response that still waits to be taken keeps its channel closed
  write_waits <= write_address_held and write_data_held and not bvalid;
  read_waits  <= read_address_held and not rvalid;

  channels_p : process (clk)
  begin
    if rising_edge(clk) then
      if s_axi_awvalid = '1' and write_address_held = '0' then
        write_address_held <= '1';
        write_address      <= s_axi_awaddr;
      end if;
      if s_axi_wvalid = '1' and write_data_held = '0' then
        write_data_held <= '1';
        write_data      <= s_axi_wdata;
        write_strobe    <= s_axi_wstrb;
      end if;
      if s_axi_arvalid = '1' and read_address_held = '0' then
        read_address_held <= '1';
        read_address      <= s_axi_araddr;
      end if;
      if s_axi_bready = '1' then
        bvalid <= '0';
      end if;
      if s_axi_rready = '1' then
        rvalid <= '0';
      end if;

      if under_way = '0' then
        if write_waits = '1' and not (read_waits = '1' and writing = '1') then
          under_way <= '1';
          writing   <= '1';
        elsif read_waits = '1' then
          under_way <= '1';
          writing   <= '0';
        end if;
      elsif answered = '1' then
        under_way <= '0';
        if writing = '1' then
          write_address_held <= '0';
          write_data_held    <= '0';
          bvalid             <= '1';
        else
          read_address_held <= '0';
          rvalid            <= '1';
          s_axi_rdata       <= read_data;
        end if;
      end if;

      if rst = '1' then
        write_address_held <= '0';
        write_data_held    <= '0';
        read_address_held  <= '0';
        under_way          <= '0';
        writing            <= '0';
        bvalid             <= '0';
        rvalid             <= '0';
      end if;
    end if;
  end process;

end architecture;
