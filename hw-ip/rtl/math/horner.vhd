-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Polynomial in the normalised radius by Horner's rule, one result per clock.
--
-- Purpose     c0 + c1 s + c2 s**2 + ..., and its derivative if wanted. Every step rounds down and saturates
-- Method      one multiply-add per coefficient but the highest, and a second one for the derivative
-- Latency     3 * (G_TERMS - 1)
-- Throughput  one per clock, no stall
-- Resources   hw-ip/synth/resources.txt
-- Twin        karst_math::horner, karst_math::horner_with_derivative

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity horner is
  generic (
    G_TERMS      : positive range 2 to 16 := 5;  -- coefficients
    G_DERIVATIVE : boolean := true               -- derivative wanted; zero otherwise
  );
  port (
    clk          : in  std_ulogic;                                    -- rising edge
    enable       : in  std_ulogic := '1';                             -- registers move; if not, a reset does nothing either
    rst          : in  std_ulogic;                                    -- synchronous, high: forgets what is under way
    coefficients : in  std_ulogic_vector(32 * G_TERMS - 1 downto 0);  -- signed, Q6.26; c0 in the low bits. Constant
                                                                      -- while results are under way
    in_valid     : in  std_ulogic;                                    -- radius is there
    radius       : in  std_ulogic_vector(31 downto 0);                -- signed, Q3.29
    out_valid    : out std_ulogic;                                    -- value and derivative are there
    value        : out std_ulogic_vector(31 downto 0);                -- signed, Q6.26
    derivative   : out std_ulogic_vector(31 downto 0)                 -- signed, Q12.20
  );
end entity;

architecture rtl of horner is

  constant STEPS        : positive := G_TERMS - 1;
  constant STEP_LATENCY : positive := 3;
  constant LATENCY      : positive := STEPS * STEP_LATENCY;
  -- Q6.26 to Q12.20
  constant SLOPE_SHIFT  : positive := 6;

  subtype word_t is std_ulogic_vector(31 downto 0);
  type word_array_t is array (natural range <>) of word_t;

  signal argument : word_array_t(0 to LATENCY);
  signal sum      : word_array_t(0 to STEPS);
  signal slope    : word_array_t(0 to STEPS);
  signal valid    : std_ulogic_vector(0 to LATENCY);

begin

  argument(0) <= radius;
  valid(0)    <= in_valid;
  sum(0)      <= coefficients(32 * G_TERMS - 1 downto 32 * STEPS);
  slope(0)    <= (others => '0');

  delay_p : process (clk)
  begin
    if rising_edge(clk) and enable = '1' then
      argument(1 to LATENCY) <= argument(0 to LATENCY - 1);
      valid(1 to LATENCY)    <= valid(0 to LATENCY - 1);
      if rst = '1' then
        valid(1 to LATENCY) <= (others => '0');
      end if;
    end if;
  end process;

  steps_g : for i in 0 to STEPS - 1 generate
    constant TERM : natural := STEPS - 1 - i;
  begin

    value_i : entity work.multiply_add
      port map (
        clk      => clk,
        enable   => enable,
        factor   => sum(i),
        argument => argument(i * STEP_LATENCY),
        addend   => coefficients(32 * TERM + 31 downto 32 * TERM),
        result   => sum(i + 1)
      );

    derivative_g : if G_DERIVATIVE generate
      signal sum_late : word_t;
    begin

      derivative_i : entity work.multiply_add
        port map (
          clk      => clk,
          enable   => enable,
          factor   => slope(i),
          argument => argument(i * STEP_LATENCY),
          addend   => sum_late,
          result   => slope(i + 1)
        );

      slope_p : process (clk)
      begin
        if rising_edge(clk) and enable = '1' then
          sum_late <= std_ulogic_vector(resize(signed(sum(i)(31 downto SLOPE_SHIFT)), 32));
        end if;
      end process;

    end generate;

    no_derivative_g : if not G_DERIVATIVE generate
      slope(i + 1) <= (others => '0');
    end generate;

  end generate;

  out_valid  <= valid(LATENCY);
  value      <= sum(STEPS);
  derivative <= slope(STEPS);

end architecture;
