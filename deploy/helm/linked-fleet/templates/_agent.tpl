{{/* An agent: (dict "root" $ "agent" …). One pod, since a name is taken by one agent at a time. */}}
{{- define "lf.agent" -}}
{{- $values := .root.Values }}
{{- $name := printf "%s-agent-%s" (include "lf.name" .root) .agent.name }}
{{- $labels := printf "%s\nlinked-fleet/agent: %s" (include "lf.selector" (dict "root" .root "part" "agent")) .agent.name }}
---
apiVersion: apps/v1
kind: Deployment
metadata:
  name: {{ $name }}
  labels: {{- include "lf.labels" (dict "root" .root "part" "agent") | nindent 4 }}
    linked-fleet/agent: {{ .agent.name }}
spec:
  replicas: 1
  strategy: {type: Recreate}
  selector:
    matchLabels: {{- $labels | nindent 6 }}
  template:
    metadata:
      labels: {{- include "lf.labels" (dict "root" .root "part" "agent") | nindent 8 }}
        linked-fleet/agent: {{ .agent.name }}
      {{- with .agent.models }}
      annotations:
        linked-fleet/models: {{ toJson . | sha256sum }}
      {{- end }}
    spec:
      {{- include "lf.pod" (dict "root" .root "user" 10001 "placement" (merge (dict) .agent $values.agentDefaults)) | nindent 6 }}
      terminationGracePeriodSeconds: 10 # the robot holds, then the agent ends
      containers:
        - name: agent
          {{- include "lf.container" (dict "root" .root "image" (merge (dict) (.agent.image | default dict) $values.images.agent) "resources" (.agent.resources | default $values.agentDefaults.resources)) | nindent 10 }}
          env:
            - {name: LINKED_FLEET_ROBOT, value: {{ join "," .agent.robots | quote }}}
            - {name: LINKED_FLEET_NAMESPACE, value: {{ $values.fleet | quote }}}
            - {name: LINKED_FLEET_ZENOH_CONNECT, value: "{{ include "lf.protocol" .root }}/{{ include "lf.routerService" .root }}:7447"}
            {{- if $values.zenoh.tls.enabled }}
            {{- include "lf.wireEnv" . | nindent 12 }}
            {{- end }}
            {{- include "lf.env" (.agent.env | default dict) | nindent 12 }}
          # No liveness probe: an agent without a router holds its robots and connects again by itself.
          readinessProbe:
            exec: {command: [python, /usr/local/lib/linked-fleet/agent_health.py]}
            periodSeconds: 10
            timeoutSeconds: 5
          volumeMounts:
            - {name: tmp, mountPath: /tmp}
            {{- if $values.zenoh.tls.enabled }}
            - {name: wire, mountPath: /etc/linked-fleet/wire, readOnly: true}
            {{- end }}
            {{- if .agent.models }}
            - {name: models, mountPath: /models, readOnly: true}
            {{- end }}
      volumes:
        - {name: tmp, emptyDir: {sizeLimit: 256Mi}}
        {{- if $values.zenoh.tls.enabled }}
        - {name: wire, secret: {secretName: {{ .agent.tlsSecret }}, defaultMode: 0440}}
        {{- end }}
        {{- if .agent.models }}
        - {name: models, configMap: {name: {{ $name }}}}
        {{- end }}
{{- if .agent.models }}
---
apiVersion: v1
kind: ConfigMap
metadata:
  name: {{ $name }}
  labels: {{- include "lf.labels" (dict "root" .root "part" "agent") | nindent 4 }}
data: {{- toYaml .agent.models | nindent 2 }}
{{- end }}
{{- end }}
