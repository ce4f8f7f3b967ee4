// Walks from the start, and compares the words of the neurons with those of the golden model.
// +vectors=1 compares the first of them only.

/* verilator lint_off WIDTH */
/* verilator lint_off UNUSEDSIGNAL */
module testbench;
    localparam int VECTORS = @vectors@, NEURONS = @neurons@, WORD = @wide@;

    logic clock = 0, reset = 1, restart = 0, run = 0, until_settled = 0, busy, settled, saturated;
    logic [31:0] limit = 0, steps;
    logic [1:0] status;
    logic signed [WORD-1:0] fine;
    logic [@word_at@-1:0] address = 0;
    logic signed [@bits@-1:0] word, data = 0;
    logic [31:0] counts [0:VECTORS-1];
    logic [@word_at@-1:0] places [0:NEURONS-1];
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

