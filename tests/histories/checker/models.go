package main

import (
	"fmt"
	"strings"
)

// Step returns the states that an operation may lead to from a state: none if the answer it got is
// impossible there. An operation without an answer always has one, since it may never take effect.
type Step func(state any, op *Operation) []any

// A Model says what one key does; its states are compared with ==.
type Model struct {
	Begin any
	Step  Step
}

// What each model promises is written in tests/histories/README.md.
var models = map[string]Model{
	"register":     {Begin: register{}, Step: stepRegister},
	"lease":        {Begin: lease{}, Step: stepLease},
	"key":          {Begin: key{}, Step: stepKey},
	"command":      {Begin: false, Step: stepCommand},
	"subscription": {Begin: false, Step: stepSubscription},
	"callback":     {Begin: callback{}, Step: stepCallback},
}

func to(state any) []any { return []any{state} }

func only(holds bool, state any) []any {
	if holds {
		return to(state)
	}
	return nil
}

// A register is read, and written under the condition that it holds what was read.
type register struct {
	there bool
	value string
}

func registerOf(value *string) register {
	if value == nil {
		return register{}
	}
	return register{true, *value}
}

func stepRegister(state any, op *Operation) []any {
	is, expected := state.(register), registerOf(op.Input.Expect)
	switch {
	case op.Input.Do == "read":
		return only(!op.Known() || is == registerOf(op.Output.Value), is)
	case op.Known() && op.Output.Is == "done":
		return only(is == expected, registerOf(op.Input.Value))
	case op.Known(): // a weak one may fail for no reason
		return only(is != expected || op.Input.Weak, is)
	case is == expected:
		return to(registerOf(op.Input.Value))
	}
	return to(is)
}

// A lease has one owner, known by a label of its own, certainly until a time that the clock of the
// recorder knows: not before the call that took it plus its duration.
type lease struct {
	label string
	until int64
}

// The server counts whole milliseconds, and its clock is adjusted now and then.
const toleranceNs = 5_000_000

func (is lease) mayBeFree(op *Operation) bool {
	return is.label == "" || op.End() >= is.until-toleranceNs
}

func stepLease(state any, op *Operation) []any {
	is := state.(lease)
	own := is.label != "" && is.label == op.Input.Token
	if !op.Known() {
		return stepLeaseUnknown(is, own, op)
	}
	switch op.Output.Is {
	case "held": // by somebody else
		return only(is.label != "" && !own && is.label == op.Output.Label, is)
	case "taken":
		return only(is.mayBeFree(op), taken(op))
	case "renewed":
		return only(own, renewed(is, op))
	case "released":
		return only(own, lease{})
	case "tied": // to a lease that has to be there
		return only(own, is)
	case "allowed":
		if own {
			return to(is)
		}
		return only(is.mayBeFree(op), lease{})
	case "free":
		return only(is.mayBeFree(op), lease{})
	}
	return nil
}

func stepLeaseUnknown(is lease, own bool, op *Operation) []any {
	var states []any
	switch {
	case op.Input.Do == "release" && own:
		return to(lease{})
	case op.Input.Do != "take":
		return to(is)
	case own:
		states = append(states, renewed(is, op))
	case is.label != "":
		states = append(states, is)
	}
	if is.mayBeFree(op) {
		states = append(states, taken(op))
	}
	return states
}

func taken(op *Operation) lease { return lease{op.Input.Label, op.Call + op.Input.For} }

func renewed(is lease, op *Operation) lease { return lease{is.label, op.Call + op.Input.For} }

// An idempotency key stands for one request and for the one invocation that it began, "?" while
// nobody has said which.
type key struct {
	id, digest string
	ran        bool
}

func (is key) called(id string) bool { return id == "?" || is.id == "?" || is.id == id }

func (is key) as(id string) key {
	if is.id == "?" {
		is.id = id
	}
	return is
}

func stepKey(state any, op *Operation) []any {
	is, new := state.(key), state.(key).id == ""
	same := is.digest == op.Input.Digest
	switch {
	case op.Input.Do == "ran":
		after := is.as(op.Input.ID)
		after.ran = true
		return only(!new && !is.ran && is.called(op.Input.ID), after)
	case !op.Known() && new:
		return to(key{id: "?", digest: op.Input.Digest})
	case !op.Known() || op.Output.Is == "refused":
		return to(is)
	case op.Output.Is == "reused":
		return only(!new && !same, is)
	case new:
		return to(key{id: op.Output.ID, digest: op.Input.Digest})
	}
	return only(same && is.called(op.Output.ID), is.as(op.Output.ID))
}

// A command runs once, and every copy of it that is accepted or repeated has run.
func stepCommand(state any, op *Operation) []any {
	ran := state.(bool)
	switch {
	case op.Input.Do == "ran":
		return only(!ran, true)
	case op.Known() && (op.Output.Is == "accepted" || op.Output.Is == "repeated"):
		return only(ran, ran)
	}
	return to(ran)
}

// A subscription is there from its creation until it is deleted.
func stepSubscription(state any, op *Operation) []any {
	there := state.(bool)
	switch {
	case op.Known() && (op.Input.Do == "list" || op.Input.Do == "delete"):
		return only(there == (op.Output.Is == "there"), there && op.Input.Do == "list")
	case op.Known() && op.Output.Is == "refused":
		return to(there)
	case op.Input.Do == "create":
		return to(true)
	case op.Input.Do == "list":
		return to(there)
	}
	return to(false)
}

// A callback gets messages that are numbered without gaps, in the order of what they tell; one that
// comes again says what it said.
type callback struct {
	number, rank int
	contents     string
}

func stepCallback(state any, op *Operation) []any {
	is, in := state.(callback), op.Input
	line := fmt.Sprintf("%d %s\n", in.Number, in.Content)
	switch {
	case in.Do == "settled":
		return only(is.rank == in.Rank, is)
	case in.Number <= is.number:
		return only(strings.HasPrefix(is.contents, line) || strings.Contains(is.contents, "\n"+line), is)
	}
	return only(in.Number == is.number+1 && in.Rank >= is.rank, callback{in.Number, in.Rank, is.contents + line})
}
