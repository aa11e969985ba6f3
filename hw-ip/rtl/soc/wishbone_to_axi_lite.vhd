-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- From Wishbone to AXI4-Lite.
--
-- Purpose     lets the processor's data bus reach the registers of the IP
-- Rules       Of a response code only its higher bit is looked at: SLVERR and DECERR are errors, the others are none.
-- Latency     1 from a request to its address, 1 from the response to the acknowledgement
-- Throughput  one access at a time
-- Resources   hw-ip/synth/resources.txt
-- Twin        none: karst_regs::RegisterBus is what software sees of it

library ieee;
use ieee.std_logic_1164.all;

entity wishbone_to_axi_lite is
  generic (
    G_ADDRESS_BITS : positive range 3 to 32 := 20  -- bits of a byte address
  );
  port (
    clk           : in  std_ulogic;                                      -- rising edge
    rst           : in  std_ulogic;                                      -- synchronous, high: forgets what is under way

    -- Wishbone
    stb           : in  std_ulogic;                                      -- a request, until it is acknowledged
    we            : in  std_ulogic;                                      -- it is a write
    adr           : in  std_ulogic_vector(G_ADDRESS_BITS - 3 downto 0);  -- address of the word
    sel           : in  std_ulogic_vector(3 downto 0);                   -- bytes to be written
    dat_mosi      : in  std_ulogic_vector(31 downto 0);                  -- the word to be written
    ack           : out std_ulogic;                                      -- it is done
    err           : out std_ulogic;                                      -- with ack: it was answered by an error
    dat_miso      : out std_ulogic_vector(31 downto 0);                  -- the word read

    -- AXI4-Lite
    m_axi_awvalid : out std_ulogic;                                      -- write address is there
    m_axi_awready : in  std_ulogic;                                      -- it is taken if it is there
    m_axi_awaddr  : out std_ulogic_vector(G_ADDRESS_BITS - 1 downto 0);  -- byte address
    m_axi_wvalid  : out std_ulogic;                                      -- write data are there
    m_axi_wready  : in  std_ulogic;                                      -- they are taken if they are there
    m_axi_wdata   : out std_ulogic_vector(31 downto 0);                  -- the data
    m_axi_wstrb   : out std_ulogic_vector(3 downto 0);                   -- bytes to be written
    m_axi_bvalid  : in  std_ulogic;                                      -- write response is there
    m_axi_bready  : out std_ulogic;                                      -- it is taken if it is there
    m_axi_bresp   : in  std_ulogic_vector(1 downto 0);                   -- how the write went
    m_axi_arvalid : out std_ulogic;                                      -- read address is there
    m_axi_arready : in  std_ulogic;                                      -- it is taken if it is there
    m_axi_araddr  : out std_ulogic_vector(G_ADDRESS_BITS - 1 downto 0);  -- byte address
    m_axi_rvalid  : in  std_ulogic;                                      -- read response is there
    m_axi_rready  : out std_ulogic;                                      -- it is taken if it is there
    m_axi_rdata   : in  std_ulogic_vector(31 downto 0);                  -- the data
    m_axi_rresp   : in  std_ulogic_vector(1 downto 0)                    -- how the read went
  );
end entity;

architecture rtl of wishbone_to_axi_lite is

  signal under_way    : std_ulogic;  -- a request has gone to AXI4-Lite
  signal awvalid      : std_ulogic;
  signal wvalid       : std_ulogic;
  signal arvalid      : std_ulogic;
  signal acknowledged : std_ulogic;

begin

  m_axi_awvalid <= awvalid;
  m_axi_wvalid  <= wvalid;
  m_axi_arvalid <= arvalid;
  m_axi_bready  <= '1';
  m_axi_rready  <= '1';
  ack           <= acknowledged;

  -- The processor holds its request until it is acknowledged
  m_axi_awaddr <= adr & "00";
  m_axi_araddr <= adr & "00";
  m_axi_wdata  <= dat_mosi;
  m_axi_wstrb  <= sel;

  access_p : process (clk)
  begin
    if rising_edge(clk) then
      acknowledged <= '0';
      err          <= '0';
      if under_way = '0' then
        if stb = '1' and acknowledged = '0' then
          under_way <= '1';
          awvalid   <= we;
          wvalid    <= we;
          arvalid   <= not we;
        end if;
      else
        if m_axi_awready = '1' then
          awvalid <= '0';
        end if;
        if m_axi_wready = '1' then
          wvalid <= '0';
        end if;
        if m_axi_arready = '1' then
          arvalid <= '0';
        end if;
        if m_axi_bvalid = '1' or m_axi_rvalid = '1' then
          under_way    <= '0';
          acknowledged <= '1';
          err          <= (m_axi_bvalid and m_axi_bresp(1)) or (m_axi_rvalid and m_axi_rresp(1));
          dat_miso     <= m_axi_rdata;
        end if;
      end if;
      if rst = '1' then
        under_way    <= '0';
        awvalid      <= '0';
        wvalid       <= '0';
        arvalid      <= '0';
        acknowledged <= '0';
        err          <= '0';
      end if;
    end if;
  end process;

end architecture;
