-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- One math block behind ports that are the same for all of them.
--
-- Purpose     bench and Verilator harness talk to every math block in the same way; the operands' places in in_data are
--             those of crates/karst-cosim/src/math.rs

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity math_blocks is
  generic (
    G_BLOCK : natural range 0 to 14 := 0  -- which block: the order of the generates below
  );
  port (
    clk       : in  std_ulogic;                       -- rising edge
    rst       : in  std_ulogic;                       -- synchronous, high
    in_valid  : in  std_ulogic;                       -- operands are there
    in_ready  : out std_ulogic;                       -- operands are taken if they are there
    in_data   : in  std_ulogic_vector(191 downto 0);  -- operands
    out_valid : out std_ulogic;                       -- result is there
    out_ready : in  std_ulogic;                       -- result is taken if it is there; pipelines do not wait for it
    out_data  : out std_ulogic_vector(63 downto 0)    -- result
  );
end entity;

architecture sim of math_blocks is

  -- azimuth has no valid bits of its own
  constant AZIMUTH_LATENCY : positive := 18;
  signal valid : std_ulogic_vector(1 to AZIMUTH_LATENCY);

begin

  valid_p : process (clk)
  begin
    if rising_edge(clk) then
      valid <= in_valid & valid(1 to AZIMUTH_LATENCY - 1);
      if rst = '1' then
        valid <= (others => '0');
      end if;
    end if;
  end process;

  sqrt_floor_g : if G_BLOCK = 0 generate
    in_ready              <= '1';
    out_data(63 downto 32) <= (others => '0');
    block_i : entity work.sqrt
      generic map (G_WIDTH => 64, G_ROUND => false)
      port map (clk => clk, rst => rst, in_valid => in_valid, radicand => in_data(63 downto 0),
                out_valid => out_valid, root => out_data(31 downto 0));
  end generate;

  sqrt_round_g : if G_BLOCK = 1 generate
    in_ready              <= '1';
    out_data(63 downto 32) <= (others => '0');
    block_i : entity work.sqrt
      generic map (G_WIDTH => 64, G_ROUND => true)
      port map (clk => clk, rst => rst, in_valid => in_valid, radicand => in_data(63 downto 0),
                out_valid => out_valid, root => out_data(31 downto 0));
  end generate;

  -- An odd and narrow radicand, several bits per stage
  sqrt_narrow_g : if G_BLOCK = 2 generate
    in_ready              <= '1';
    out_data(63 downto 12) <= (others => '0');
    block_i : entity work.sqrt
      generic map (G_WIDTH => 23, G_ROUND => true, G_BITS_PER_STAGE => 3)
      port map (clk => clk, rst => rst, in_valid => in_valid, radicand => in_data(22 downto 0),
                out_valid => out_valid, root => out_data(11 downto 0));
  end generate;

  divide_g : if G_BLOCK = 3 generate
    in_ready <= '1';
    block_i : entity work.divide
      port map (clk => clk, rst => rst, in_valid => in_valid, numerator => in_data(63 downto 0),
                denominator => in_data(127 downto 64), out_valid => out_valid, quotient => out_data);
  end generate;

  -- A quotient that is narrower than the numerator, several bits per stage
  divide_narrow_g : if G_BLOCK = 4 generate
    in_ready              <= '1';
    out_data(63 downto 26) <= (others => out_data(25));
    block_i : entity work.divide
      generic map (G_NUMERATOR_WIDTH => 57, G_DENOMINATOR_WIDTH => 33, G_QUOTIENT_WIDTH => 26,
                   G_BITS_PER_STAGE => 4)
      port map (clk => clk, rst => rst, in_valid => in_valid, numerator => in_data(56 downto 0),
                denominator => in_data(96 downto 64), out_valid => out_valid, quotient => out_data(25 downto 0));
  end generate;

  -- Coefficients travel with their radius: each is held back until its step
  horner_g : if G_BLOCK = 5 generate
    constant TERMS : positive := 5;
    type history_t is array (0 to 3 * TERMS) of std_ulogic_vector(32 * TERMS - 1 downto 0);
    signal history      : history_t;
    signal coefficients : std_ulogic_vector(32 * TERMS - 1 downto 0);
  begin
    in_ready   <= '1';
    history(0) <= in_data(32 * TERMS + 31 downto 32);
    history(1 to history'high) <= history(0 to history'high - 1) when rising_edge(clk);
    coefficients(32 * TERMS - 1 downto 32 * TERMS - 32) <= history(0)(32 * TERMS - 1 downto 32 * TERMS - 32);
    terms_g : for i in 0 to TERMS - 2 generate
      coefficients(32 * i + 31 downto 32 * i) <= history(3 * (TERMS - 2 - i) + 1)(32 * i + 31 downto 32 * i);
    end generate;
    block_i : entity work.horner
      generic map (G_TERMS => TERMS, G_DERIVATIVE => true)
      port map (clk => clk, rst => rst, coefficients => coefficients, in_valid => in_valid,
                radius => in_data(31 downto 0), out_valid => out_valid, value => out_data(31 downto 0),
                derivative => out_data(63 downto 32));
  end generate;

  azimuth_g : if G_BLOCK = 6 generate
    in_ready               <= '1';
    out_valid              <= valid(AZIMUTH_LATENCY);
    out_data(63 downto 16) <= (others => '0');
    block_i : entity work.azimuth
      generic map (G_BITS => 16)
      port map (clk => clk, reversed => '0', x => in_data(16 downto 0), y => in_data(48 downto 32),
                angle => out_data(15 downto 0));
  end generate;

  -- The detector's width
  azimuth_narrow_g : if G_BLOCK = 7 generate
    in_ready               <= '1';
    out_valid              <= valid(AZIMUTH_LATENCY);
    out_data(63 downto 16) <= (others => '0');
    block_i : entity work.azimuth
      generic map (G_BITS => 15)
      port map (clk => clk, reversed => '0', x => in_data(15 downto 0), y => in_data(47 downto 32),
                angle => out_data(15 downto 0));
  end generate;

  sqrt_sequential_g : if G_BLOCK = 8 generate
    out_data(63 downto 32) <= (others => '0');
    block_i : entity work.sqrt_sequential
      generic map (G_WIDTH => 64, G_ROUND => true)
      port map (clk => clk, rst => rst, in_valid => in_valid, in_ready => in_ready, radicand => in_data(63 downto 0),
                out_valid => out_valid, out_ready => out_ready, root => out_data(31 downto 0));
  end generate;

  divide_sequential_g : if G_BLOCK = 9 generate
    block_i : entity work.divide_sequential
      port map (clk => clk, rst => rst, in_valid => in_valid, in_ready => in_ready, numerator => in_data(63 downto 0),
                denominator => in_data(127 downto 64), out_valid => out_valid, out_ready => out_ready,
                quotient => out_data);
  end generate;

  -- With the shift above the inverse: exact with three bits per stage, coarse with one to four
  reciprocals_g : if G_BLOCK >= 10 generate
    constant EXACT          : boolean  := G_BLOCK = 10;
    constant BITS_PER_STAGE : positive := G_BLOCK - 10 + 3 * boolean'pos(EXACT);
    constant LATENCY        : positive := 3 + 5 * boolean'pos(EXACT) + (17 + BITS_PER_STAGE - 1) / BITS_PER_STAGE;
    signal valid      : std_ulogic_vector(1 to LATENCY);
    signal shift      : unsigned(4 downto 0);
    signal shift_line : signed(4 downto 0);
    signal shift_late : signed(4 downto 0);
  begin
    in_ready               <= '1';
    out_data(63 downto 37) <= (others => '0');
    out_data(36 downto 32) <= std_ulogic_vector(shift_late);
    out_valid              <= valid(LATENCY);
    block_i : entity work.reciprocal
      generic map (G_EXACT => EXACT, G_BITS_PER_STAGE => BITS_PER_STAGE)
      port map (clk => clk, value => unsigned(in_data(31 downto 0)), shift => shift,
                std_ulogic_vector(inverse) => out_data(31 downto 0));
    shift_line <= signed(shift);
    shift_i : entity work.delay
      generic map (G_WIDTH => 5, G_CLOCKS => LATENCY - 2)
      port map (clk => clk, value => shift_line, later => shift_late);

    valid_p : process (clk)
    begin
      if rising_edge(clk) then
        valid <= in_valid & valid(1 to LATENCY - 1);
        if rst = '1' then
          valid <= (others => '0');
        end if;
      end if;
    end process;
  end generate;

end architecture;
