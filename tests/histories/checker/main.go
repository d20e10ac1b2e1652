// Command histories tells whether a recorded history could have come from one copy of everything that
// does one operation at a time (linearizability). The search is porcupine's; ours are the models.
//
// It reads operations as JSON lines from standard input and writes a verdict as JSON. It exits with 1
// for a history that breaks a model and for one that could not be decided, with 2 for no history.
package main

import (
	"encoding/json"
	"flag"
	"fmt"
	"os"
	"time"

	"github.com/anishathalye/porcupine"
)

// Verdict is the answer.
type Verdict struct {
	Operations map[string]int `json:"operations"`
	Unknown    int            `json:"unknown"`
	Keys       int            `json:"keys"`
	Violations []Finding      `json:"violations"`
	Undecided  []Finding      `json:"undecided"`
}

// Finding is a key whose operations break its model, as far as they are needed for that: the last one
// to be answered is impossible after the others.
type Finding struct {
	Model      string   `json:"model"`
	Key        string   `json:"key"`
	Impossible string   `json:"impossible,omitempty"`
	History    []string `json:"history,omitempty"`
}

func main() {
	limit := flag.Duration("limit", time.Minute, "for the search in one key")
	flag.Parse()
	partitions, err := readHistory(os.Stdin)
	if err != nil {
		fmt.Fprintln(os.Stderr, "histories:", err)
		os.Exit(2)
	}
	verdict := judge(partitions, *limit)
	out := json.NewEncoder(os.Stdout)
	out.SetEscapeHTML(false)
	if err := out.Encode(verdict); err != nil {
		fmt.Fprintln(os.Stderr, "histories:", err)
		os.Exit(2)
	}
	if len(verdict.Violations)+len(verdict.Undecided) > 0 {
		os.Exit(1)
	}
}

func judge(partitions []Partition, limit time.Duration) Verdict {
	verdict := Verdict{map[string]int{}, 0, len(partitions), []Finding{}, []Finding{}}
	for _, each := range partitions {
		verdict.Operations[each.Model] += len(each.Operations)
		for _, op := range each.Operations {
			if !op.Known() {
				verdict.Unknown++
			}
		}
		switch check(each, limit) {
		case porcupine.Illegal:
			verdict.Violations = append(verdict.Violations, explain(each, limit))
		case porcupine.Unknown:
			verdict.Undecided = append(verdict.Undecided, Finding{Model: each.Model, Key: each.Key})
		}
	}
	return verdict
}

func check(partition Partition, limit time.Duration) porcupine.CheckResult {
	model := models[partition.Model]
	search := porcupine.NondeterministicModel{
		Init: func() []any { return []any{model.Begin} },
		Step: func(state, input, _ any) []any { return model.Step(state, input.(*Operation)) },
	}
	history := make([]porcupine.Operation, len(partition.Operations))
	for i, op := range partition.Operations {
		history[i] = porcupine.Operation{ClientId: op.Client, Input: op, Call: op.Call, Return: op.End()}
	}
	return porcupine.CheckOperationsTimeout(search.ToModel(), history, limit)
}

// explain finds the first answer that is impossible: every history that goes on after it is illegal too.
func explain(partition Partition, limit time.Duration) Finding {
	found := Finding{Model: partition.Model, Key: partition.Key}
	for _, last := range partition.Answered() {
		until := partition.Before(last.End())
		if check(until, limit) == porcupine.Illegal {
			found.Impossible = last.String()
			for _, op := range until.Operations {
				found.History = append(found.History, op.String())
			}
			break
		}
	}
	return found
}
