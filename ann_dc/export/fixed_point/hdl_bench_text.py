"""Text templates of a SystemVerilog export: testbench, Makefile and README."""

from ann_dc.export.fixed_point.readme_text import FORMATS

BENCH = """\
// Walks from the start, and compares the words of the neurons with those of the golden model.
// +vectors=1 compares the first of them only.

/* verilator lint_off WIDTH */
/* verilator lint_off UNUSEDSIGNAL */
module testbench;
    localparam int VECTORS = @VECTORS@, NEURONS = @NEURONS@, WORD = @WORD@;

    logic clock = 0, reset = 1, restart = 0, run = 0, until_settled = 0, busy, settled, saturated;
    logic [31:0] limit = 0, steps;
    logic [1:0] status;
    logic signed [WORD-1:0] fine;
    logic [@WORD_AT@-1:0] address = 0;
    logic signed [@BITS@-1:0] word, data = 0;
    logic [31:0] counts [0:VECTORS-1];
    logic [@WORD_AT@-1:0] places [0:NEURONS-1];
    logic [WORD-1:0] expected [0:VECTORS*NEURONS-1];
    int vectors, differ, v, n;

    ann_dc_network network (
        .clock(clock), .reset(reset), .restart(restart), .run(run), .limit(limit),
        .until_settled(until_settled), .busy(busy), .settled(settled),
        .saturated(saturated), .status(status), .steps(steps),
        .load(1'b0), .address(address), .data(data), .word(word), .fine(fine)
    );

    always #5 clock = !clock;

    task automatic wait_until_idle;
        @(negedge clock);
        restart = 0;
        run = 0;
        while (busy) @(negedge clock);
    endtask

    task automatic walk(input logic [31:0] count, input logic stop);
        restart = 1;
        wait_until_idle;
        run = 1;
        limit = count;
        until_settled = stop;
        wait_until_idle;
    endtask

    initial begin
        $readmemh("counts.hex", counts);
        $readmemh("places.hex", places);
        $readmemh("expected.hex", expected);
        if (!$value$plusargs("vectors=%d", vectors)) vectors = VECTORS;
        differ = 0;
        repeat (2) @(negedge clock);
        reset = 0;
        for (v = 0; v < vectors; v = v + 1) begin
            walk(counts[v], 0);
            for (n = 0; n < NEURONS; n = n + 1) begin
                address = places[n];
                @(negedge clock);
                if (fine !== $signed(expected[v*NEURONS+n])) differ = differ + 1;
            end
        end
        if (vectors == VECTORS) begin
            walk(2 * counts[VECTORS-1], 1);
            if (steps !== counts[VECTORS-1] || status !== 1) differ = differ + 1;
        end
        $display("%s: %0d differences in %0d vectors, the last after %0d steps",
            differ == 0 ? "PASS" : "FAIL", differ, vectors, steps);
        $finish;
    end
endmodule

"""

MAKEFILE = """\
DESIGN = ann_dc_network.sv testbench.sv

icarus: $(DESIGN)
	iverilog -g2012 -o simulation $(DESIGN)
	vvp -n simulation

verilator: $(DESIGN)
	verilator --binary -O3 --top-module testbench $(DESIGN)
	./obj_dir/Vtestbench

clean:
	rm -rf simulation obj_dir

.PHONY: icarus verilator clean
"""

README = (
    """\
# {title}: SystemVerilog

`make icarus` or `make verilator` compares the design with the golden model, bit for bit; the
simulation says PASS or FAIL. A step takes about {clocks} clocks. The memories are filled from the
`.hex` files; put them where the tool that synthesises looks for them.

While `busy` is low: `restart` brings the start back, `load` writes `data` into the word at
`address`, `run` takes steps, `limit` at most ({limit} if it is 0). The word of an input at a stage
and of a control are in the tables. `status` is 0 running, 1 settled, 2 saturated, 3 limit; controls
are an answer in 1 alone. A number for `data` that does not fit is to be refused outside.

| input | words, stage by stage |
|---|---|
{input_words}

| control | word |
|---|---|
{control_words}

"""
    + FORMATS
)
