package main

import (
	"bufio"
	"encoding/json"
	"fmt"
	"io"
	"math"
	"sort"
)

// Operation is one line of a history. Without an answer Return and Output are absent: nobody knows
// whether it took effect, and it may still do so at any later time.
type Operation struct {
	Client int    `json:"client"`
	Model  string `json:"model"`
	Key    string `json:"key"`
	Call   int64  `json:"call"`
	Return *int64 `json:"return"`
	Input  Input  `json:"input"`
	Output Output `json:"output"`
}

// Input holds what was asked for, the fields of all models together.
type Input struct {
	Do      string  `json:"do"`
	Expect  *string `json:"expect,omitempty"`
	Value   *string `json:"value,omitempty"`
	Weak    bool    `json:"weak,omitempty"`
	Label   string  `json:"label,omitempty"`
	Token   string  `json:"token,omitempty"`
	For     int64   `json:"for,omitempty"`
	ID      string  `json:"id,omitempty"`
	Digest  string  `json:"digest,omitempty"`
	Number  int     `json:"number,omitempty"`
	Rank    int     `json:"rank,omitempty"`
	Content string  `json:"content,omitempty"`
}

// Output holds what was answered, the fields of all models together.
type Output struct {
	Value *string `json:"value,omitempty"`
	Is    string  `json:"is,omitempty"`
	Label string  `json:"label,omitempty"`
	ID    string  `json:"id,omitempty"`
}

// Known tells whether the operation was answered.
func (op *Operation) Known() bool { return op.Return != nil }

// End is the time of the answer; of an operation without one the end of time.
func (op *Operation) End() int64 {
	if op.Return == nil {
		return math.MaxInt64
	}
	return *op.Return
}

func (op *Operation) String() string {
	input, _ := json.Marshal(op.Input)
	output, _ := json.Marshal(op.Output)
	if !op.Known() {
		return fmt.Sprintf("%d..        client %d %s -> unknown", op.Call, op.Client, input)
	}
	return fmt.Sprintf("%d..%d client %d %s -> %s", op.Call, *op.Return, op.Client, input, output)
}

// Partition holds the operations on one key of one model, in the order of their calls.
type Partition struct {
	Model, Key string
	Operations []*Operation
}

func readHistory(from io.Reader) ([]Partition, error) {
	found := map[[2]string]*Partition{}
	lines := bufio.NewScanner(from)
	lines.Buffer(nil, 1<<20)
	for number := 1; lines.Scan(); number++ {
		op := new(Operation)
		if err := json.Unmarshal(lines.Bytes(), op); err != nil {
			return nil, fmt.Errorf("line %d: %w", number, err)
		}
		if _, known := models[op.Model]; !known {
			return nil, fmt.Errorf("line %d: there is no model %q", number, op.Model)
		}
		if op.Known() && *op.Return < op.Call {
			return nil, fmt.Errorf("line %d: it returns before it is called", number)
		}
		at := [2]string{op.Model, op.Key}
		if found[at] == nil {
			found[at] = &Partition{Model: op.Model, Key: op.Key}
		}
		found[at].Operations = append(found[at].Operations, op)
	}
	return sorted(found), lines.Err()
}

func sorted(found map[[2]string]*Partition) []Partition {
	partitions := make([]Partition, 0, len(found))
	for _, each := range found {
		ops := each.Operations
		sort.SliceStable(ops, func(i, j int) bool { return ops[i].Call < ops[j].Call })
		partitions = append(partitions, *each)
	}
	sort.Slice(partitions, func(i, j int) bool {
		if partitions[i].Model != partitions[j].Model {
			return partitions[i].Model < partitions[j].Model
		}
		return partitions[i].Key < partitions[j].Key
	})
	return partitions
}

// Before returns the partition as it looked right after a moment: what was not called is absent, what was
// not answered is unknown.
func (p Partition) Before(moment int64) Partition {
	cut := Partition{Model: p.Model, Key: p.Key}
	for _, op := range p.Operations {
		if op.Call > moment {
			break
		}
		if op.End() > moment {
			open := *op
			open.Return, open.Output = nil, Output{}
			op = &open
		}
		cut.Operations = append(cut.Operations, op)
	}
	return cut
}

// Answered lists the operations that were answered, in the order of their answers.
func (p Partition) Answered() []*Operation {
	var answered []*Operation
	for _, op := range p.Operations {
		if op.Known() {
			answered = append(answered, op)
		}
	}
	sort.SliceStable(answered, func(i, j int) bool { return *answered[i].Return < *answered[j].Return })
	return answered
}
