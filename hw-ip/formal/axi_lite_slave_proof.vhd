-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- What is proven of axi_lite_slave, for any length of time.
--
-- Assumed     the master keeps an address or data as they are until they are taken; a request is answered, at its first clock
--             or up to 3 clocks later, and nothing else is
-- Proven      a response, and its data, stay until they are taken; there is a response for every write and every read and
--             none besides: never more than addresses, or data, that were taken; a read gives what it was answered with;
--             a request stays as it is until it is answered, and is for what the master has sent; an access that is
--             complete is requested within 9 clocks, whatever the other channels do
-- Method      `cargo xtask hw formal` makes assumptions and assertions of the outputs. PSL would say the same, but what
--             GHDL 2.0 converts it to carries a state that an inductive proof may choose, and so switch assumptions off
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity axi_lite_slave_proof is
  port (
    clk            : in std_ulogic;                         -- rising edge
    s_axi_awvalid  : in std_ulogic;                         -- write address is there; all inputs: any values
    s_axi_awaddr   : in std_ulogic_vector(3 downto 0);      -- write address
    s_axi_wvalid   : in std_ulogic;                         -- write data are there
    s_axi_wdata    : in std_ulogic_vector(31 downto 0);     -- write data
    s_axi_wstrb    : in std_ulogic_vector(3 downto 0);      -- bytes to be written
    s_axi_bready   : in std_ulogic;                         -- write response is taken
    s_axi_arvalid  : in std_ulogic;                         -- read address is there
    s_axi_araddr   : in std_ulogic_vector(3 downto 0);      -- read address
    s_axi_rready   : in std_ulogic;                         -- read response is taken
    answered       : in std_ulogic;                         -- the request is answered
    read_data      : in std_ulogic_vector(31 downto 0);     -- with this
    assumed        : out std_ulogic;                        -- what is assumed holds
    proven_stay    : out std_ulogic;                        -- responses stay until they are taken
    proven_count   : out std_ulogic;                        -- no response is lost and none comes besides
    proven_data    : out std_ulogic;                        -- a read gives what it was answered with
    proven_request : out std_ulogic;                        -- a request stays, and is what the master has sent
    proven_waiting : out std_ulogic                         -- a complete access is requested in time
  );
end entity;

architecture proof of axi_lite_slave_proof is

  constant MOST_ANSWER  : positive := 3;
  constant MOST_WAITING : positive := 9;

  signal rst          : std_ulogic := '1';
  signal awready      : std_ulogic;
  signal wready       : std_ulogic;
  signal bvalid       : std_ulogic;
  signal bresp        : std_ulogic_vector(1 downto 0);
  signal arready      : std_ulogic;
  signal rvalid       : std_ulogic;
  signal rdata        : std_ulogic_vector(31 downto 0);
  signal rresp        : std_ulogic_vector(1 downto 0);
  signal request      : std_ulogic;
  signal is_write     : std_ulogic;
  signal address      : std_ulogic_vector(3 downto 0);
  signal write_data   : std_ulogic_vector(31 downto 0);
  signal write_strobe : std_ulogic_vector(3 downto 0);

  -- What was seen a clock ago
  signal before        : std_ulogic := '0';  -- there was one, without reset
  signal before_aw     : std_ulogic;         -- address there, and not taken
  signal before_awaddr : std_ulogic_vector(3 downto 0);
  signal before_w      : std_ulogic;
  signal before_wdata  : std_ulogic_vector(31 downto 0);
  signal before_wstrb  : std_ulogic_vector(3 downto 0);
  signal before_ar     : std_ulogic;
  signal before_araddr : std_ulogic_vector(3 downto 0);
  signal before_b      : std_ulogic;         -- response there, and not taken
  signal before_r      : std_ulogic;
  signal before_rdata  : std_ulogic_vector(31 downto 0);
  signal before_q      : std_ulogic;         -- request there, and not answered
  signal before_write  : std_ulogic;

  -- Addresses and data taken less responses taken
  signal aw_open : unsigned(2 downto 0);
  signal w_open  : unsigned(2 downto 0);
  signal ar_open : unsigned(2 downto 0);

  -- What was taken last, and what a read was answered with last
  signal taken_awaddr  : std_ulogic_vector(3 downto 0);
  signal taken_wdata   : std_ulogic_vector(31 downto 0);
  signal taken_wstrb   : std_ulogic_vector(3 downto 0);
  signal taken_araddr  : std_ulogic_vector(3 downto 0);
  signal answered_data : std_ulogic_vector(31 downto 0);

  signal answer_clocks  : unsigned(2 downto 0);  -- a request has waited for its answer
  signal write_clocks   : unsigned(4 downto 0);  -- a complete write has waited
  signal read_clocks    : unsigned(4 downto 0);  -- a complete read has waited

  signal can_write  : std_ulogic;  -- a write is complete and its response has room
  signal can_read   : std_ulogic;
  signal master_ok  : std_ulogic;
  signal answer_ok  : std_ulogic;

begin

  slave_i : entity work.axi_lite_slave
    generic map (G_ADDRESS_BITS => 4)
    port map (
      clk => clk, rst => rst,
      s_axi_awvalid => s_axi_awvalid, s_axi_awready => awready, s_axi_awaddr => s_axi_awaddr,
      s_axi_wvalid => s_axi_wvalid, s_axi_wready => wready, s_axi_wdata => s_axi_wdata, s_axi_wstrb => s_axi_wstrb,
      s_axi_bvalid => bvalid, s_axi_bready => s_axi_bready, s_axi_bresp => bresp,
      s_axi_arvalid => s_axi_arvalid, s_axi_arready => arready, s_axi_araddr => s_axi_araddr,
      s_axi_rvalid => rvalid, s_axi_rready => s_axi_rready, s_axi_rdata => rdata, s_axi_rresp => rresp,
      request => request, is_write => is_write, address => address, write_data => write_data,
      write_strobe => write_strobe, answered => answered, read_data => read_data);

  can_write <= not awready and not wready and not bvalid;
  can_read  <= not arready and not rvalid;

  observe_p : process (clk)
    function step(count : unsigned; up, down : std_ulogic) return unsigned is
    begin
      if up = '1' and down = '0' then
        return count + 1;
      elsif up = '0' and down = '1' then
        return count - 1;
      end if;
      return count;
    end function;
  begin
    if rising_edge(clk) then
      rst    <= '0';
      before <= not rst;
      if s_axi_awvalid = '1' and awready = '1' then
        taken_awaddr <= s_axi_awaddr;
      end if;
      if s_axi_wvalid = '1' and wready = '1' then
        taken_wdata <= s_axi_wdata;
        taken_wstrb <= s_axi_wstrb;
      end if;
      if s_axi_arvalid = '1' and arready = '1' then
        taken_araddr <= s_axi_araddr;
      end if;
      before_aw     <= s_axi_awvalid and not awready;
      before_awaddr <= s_axi_awaddr;
      before_w      <= s_axi_wvalid and not wready;
      before_wdata  <= s_axi_wdata;
      before_wstrb  <= s_axi_wstrb;
      before_ar     <= s_axi_arvalid and not arready;
      before_araddr <= s_axi_araddr;
      before_b      <= bvalid and not s_axi_bready;
      before_r      <= rvalid and not s_axi_rready;
      before_rdata  <= rdata;
      before_q      <= request and not answered;
      before_write  <= is_write;

      aw_open <= step(aw_open, s_axi_awvalid and awready, bvalid and s_axi_bready);
      w_open  <= step(w_open, s_axi_wvalid and wready, bvalid and s_axi_bready);
      ar_open <= step(ar_open, s_axi_arvalid and arready, rvalid and s_axi_rready);
      if answered = '1' and is_write = '0' then
        answered_data <= read_data;
      end if;

      answer_clocks <= (others => '0');
      if request = '1' and answered = '0' then
        answer_clocks <= answer_clocks + 1;
      end if;
      write_clocks <= (others => '0');
      if can_write = '1' and not (request = '1' and is_write = '1') then
        write_clocks <= write_clocks + 1;
      end if;
      read_clocks <= (others => '0');
      if can_read = '1' and not (request = '1' and is_write = '0') then
        read_clocks <= read_clocks + 1;
      end if;
      if rst = '1' then
        aw_open       <= (others => '0');
        w_open        <= (others => '0');
        ar_open       <= (others => '0');
        answer_clocks <= (others => '0');
        write_clocks  <= (others => '0');
        read_clocks   <= (others => '0');
      end if;
    end if;
  end process;

  master_ok <= '1' when before = '0' or (
                 (before_aw = '0' or (s_axi_awvalid = '1' and s_axi_awaddr = before_awaddr)) and
                 (before_w = '0' or (s_axi_wvalid = '1' and s_axi_wdata = before_wdata and s_axi_wstrb = before_wstrb)) and
                 (before_ar = '0' or (s_axi_arvalid = '1' and s_axi_araddr = before_araddr))) else '0';
  answer_ok <= '1' when (answered = '0' or request = '1') and
                        (request = '0' or answered = '1' or answer_clocks < MOST_ANSWER) else
               '0';
  assumed   <= master_ok and answer_ok;

  proven_stay <= '1' when before = '0' or
                          ((before_b = '0' or bvalid = '1') and
                           (before_r = '0' or (rvalid = '1' and rdata = before_rdata))) else
                 '0';

  -- What is open is held in a channel or is a response
  proven_count <= '1' when rst = '1' or
                           (aw_open = unsigned'("00" & not awready) + unsigned'("00" & bvalid) and
                            w_open = unsigned'("00" & not wready) + unsigned'("00" & bvalid) and
                            ar_open = unsigned'("00" & not arready) + unsigned'("00" & rvalid)) else
                  '0';

  proven_data <= '1' when rst = '1' or (bresp = "00" and rresp = "00" and (rvalid = '0' or rdata = answered_data)) else
                 '0';

  proven_request <= '0' when before = '1' and before_q = '1' and (request = '0' or is_write /= before_write) else
                    '1' when rst = '1' or request = '0' else
                    '1' when is_write = '1' and can_write = '1' and address = taken_awaddr(3 downto 2) & "00" and
                             write_data = taken_wdata and write_strobe = taken_wstrb else
                    '1' when is_write = '0' and can_read = '1' and address = taken_araddr(3 downto 2) & "00" else
                    '0';

  proven_waiting <= '1' when rst = '1' or (write_clocks <= MOST_WAITING and read_clocks <= MOST_WAITING) else '0';

end architecture;
